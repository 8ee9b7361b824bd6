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
def test_believed_history_beats_gaze_alone_on_real_sessions(data):
    pytest.importorskip("torch")
    from hilbridge.learning.experiments.gaze_history import evaluate_gaze_with_history

    result = evaluate_gaze_with_history(data / "egtea")
    assert result.gaze_nll != result.marginal_nll
    assert result.windows > 900
    assert result.history_nll < result.gaze_nll
    assert result.history_recipe_nll < result.history_nll
