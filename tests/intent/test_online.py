import numpy as np
import pytest

from hilbridge.intent.calibration import softmax
from hilbridge.intent.history import BelievedHistory, HistoryPrior
from hilbridge.intent.online import BLOCK_TICKS, ConfidenceDrift, DriftAlarm, OnlineTemperature, Usual


def actions(count, heat, seed):
    """Logits that are `heat` times too hot for the labels drawn from them."""
    rng = np.random.default_rng(seed)
    true = rng.normal(0.0, 1.5, size=(count, 21))
    labels = np.array([rng.choice(21, p=row) for row in softmax(true)])
    return heat * true, labels


def watch(alarm, logits, labels):
    for count, (row, label) in enumerate(zip(logits, labels, strict=True), start=1):
        p = softmax(row)
        if alarm.update(float(p.max()), bool(p.argmax() == label)):
            return count
    return None


def test_the_alarm_is_rare_for_a_calibrated_wearer_and_quick_for_an_overconfident_one():
    false = sum(watch(DriftAlarm(0.05), *actions(400, 1.0, seed)) is not None for seed in range(60))
    assert false <= 6
    delays = [watch(DriftAlarm(0.05), *actions(400, 3.0, 100 + seed)) for seed in range(20)]
    assert all(delay is not None and delay < 120 for delay in delays)


def test_the_alarm_stays_until_reset_and_ignores_what_is_no_probability():
    alarm = DriftAlarm(0.05)
    assert not alarm.update(float("nan"), True)
    for _ in range(50):
        alarm.update(0.95, False)
    assert alarm.raised
    assert alarm.update(0.2, True)
    alarm.reset()
    assert not alarm.raised
    with pytest.raises(ValueError, match="alpha"):
        DriftAlarm(0.0)


def test_the_temperature_follows_one_wearer_and_lowers_the_nll():
    logits, labels = actions(600, 3.0, 7)
    online = OnlineTemperature(1.0)
    before, after = [], []
    for index, (row, label) in enumerate(zip(logits, labels, strict=True)):
        if index >= 300:
            before.append(-np.log(softmax(row)[label]))
            after.append(-np.log(softmax(row / online.temperature)[label]))
        online.update(row, int(label))
    assert 1.8 < online.temperature < 4.0
    assert np.mean(after) < np.mean(before) - 0.2


def test_a_calibrated_wearer_keeps_the_fitted_temperature_and_odd_logits_change_nothing():
    online = OnlineTemperature(1.0)
    for row, label in zip(*actions(600, 1.0, 8), strict=True):
        online.update(row, int(label))
    assert 0.75 < online.temperature < 1.35
    kept = online.temperature
    assert online.update(np.full(21, np.nan), 3) == kept
    with pytest.raises(ValueError, match="temperature"):
        OnlineTemperature(0.0)


def prior(trust):
    transitions = np.array([[0.1, 0.8, 0.1], [0.1, 0.1, 0.8], [0.8, 0.1, 0.1]])
    flat = np.full(3, 1 / 3)
    return HistoryPrior(transitions, flat, flat, trust)


def test_believed_history_follows_the_chain_and_is_only_a_prior():
    history = BelievedHistory(prior(1.0))
    flat = np.full(3, 1 / 3)
    assert history.fuse(flat) == pytest.approx(flat)
    history.advance(np.array([1.0, 0.0, 0.0]))
    assert history.fuse(flat) == pytest.approx([0.1, 0.8, 0.1])
    assert history.fuse(np.array([0.98, 0.01, 0.01])).argmax() == 0
    history.reset()
    assert history.fuse(flat) == pytest.approx(flat)


def test_without_trust_the_sensors_do_not_count():
    history = BelievedHistory(prior(0.0))
    assert history.fuse(np.array([0.98, 0.01, 0.01])) == pytest.approx(np.full(3, 1 / 3))


@pytest.mark.parametrize(
    "broken",
    [{"trust": 1.5}, {"start": np.array([0.5, 0.5, 0.5])}, {"marginal": np.array([1.0, 0.0, 0.0])}],
)
def test_what_is_no_prior_is_refused(broken):
    given = {"transitions": np.eye(3), "start": np.full(3, 1 / 3), "marginal": np.full(3, 1 / 3), "trust": 0.5}
    with pytest.raises(ValueError):
        HistoryPrior(**{**given, **broken})


def blocks(drift: ConfidenceDrift, means: np.ndarray, condition: int = 7) -> int | None:
    """After how many blocks of these means the alarm is raised."""
    for count, mean in enumerate(means, 1):
        for _ in range(BLOCK_TICKS):
            drift.update(float(mean), condition)
        if drift.raised:
            return count
    return None


def test_confidence_alone_raises_a_wearer_unlike_the_bundles_people_and_seldom_one_who_is_like_them():
    usual = Usual(0.3, 0.5, 7)
    rng = np.random.default_rng(3)
    edge = [blocks(ConfidenceDrift(usual, 0.05), rng.choice([0.2, 0.8], 200)) for _ in range(80)]  # on average 0.5
    assert sum(found is not None for found in edge) <= 8
    high, low = ConfidenceDrift(usual), ConfidenceDrift(usual)
    assert blocks(high, np.full(200, 0.8)) is not None
    assert blocks(low, np.full(200, 0.05)) is not None
    assert (high.raised, low.raised) == ("above", "below")
    assert blocks(ConfidenceDrift(usual), np.full(400, 0.4)) is None


def test_other_conditions_and_what_is_no_number_say_nothing_and_an_alarm_stays():
    drift = ConfidenceDrift(Usual(0.3, 0.5, 7))
    assert blocks(drift, np.full(100, 0.9), condition=5) is None
    assert drift.update(float("nan"), 7) is None
    assert blocks(drift, np.full(200, 0.9)) is not None
    assert blocks(drift, np.full(50, 0.4)) == 1
    with pytest.raises(ValueError, match="usual confidence"):
        ConfidenceDrift(Usual(0.5, 0.3, 7))
