import pytest

pytest.importorskip("sklearn")


@pytest.mark.data
@pytest.mark.slow
def test_history_on_the_real_annotations_beats_the_sensors_top5(egtea):
    from hilbridge.learning.data.egtea import load_actions
    from hilbridge.learning.experiments.annotated_history import evaluate_history

    result = evaluate_history(load_actions(egtea), count=8)
    assert result.windows == 15_484
    assert result.top1 >= 0.30
    assert result.top5 >= 0.77
    assert result.ece15 <= 0.045


@pytest.mark.data
@pytest.mark.slow
def test_believed_history_on_real_sessions_is_told_by_person(data):
    pytest.importorskip("torch")
    from hilbridge.learning.experiments.gaze_history import evaluate_gaze_with_history

    result = evaluate_gaze_with_history(data / "egtea")
    assert result.gaze_nll != result.marginal_nll
    assert result.windows > 900
    assert result.gain == pytest.approx(result.gaze_nll - result.history_nll, abs=1e-6)
    assert result.gain_low <= result.gain <= result.gain_high
    assert 0 <= result.people_better <= result.people


def test_no_row_knows_when_an_action_under_way_will_end():
    from dataclasses import replace

    from hilbridge.learning.data.egtea import Action
    from hilbridge.learning.experiments.annotated_history import history_features

    session = [
        Action("P01-R01-Soup", "P01", start, end, "Cut", 3) for start, end in ((0, 900), (1_000, 9_000), (4_000, 5_000))
    ]
    later = [session[0], replace(session[1], end_ms=12_000), session[2]]
    assert (history_features(session, ["Soup"])[2] == history_features(later, ["Soup"])[2]).all()
    ended = [session[0], replace(session[1], end_ms=3_000), session[2]]
    assert (history_features(session, ["Soup"])[2] != history_features(ended, ["Soup"])[2]).any()


def test_everybody_is_tested_once_whatever_their_number():
    pytest.importorskip("torch")
    from hilbridge.learning.experiments.gaze_history import _splits

    for count in (3, 11, 12, 13, 14, 31, 32):
        people = [f"P{number:02}" for number in range(count)]
        splits = _splits(people)
        assert sorted(name for test, _ in splits for name in test) == people
        assert all(not test & held and len(test | held) < count for test, held in splits)
