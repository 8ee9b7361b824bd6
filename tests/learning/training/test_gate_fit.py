"""Maps are fitted on what the gate compares, and keep what they promise on streams that are known."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("sklearn")
pytest.importorskip("torch")

from hilbridge.confidence import MASKS, condition_of
from hilbridge.features.layout import D
from hilbridge.intent.online import ConfidenceDrift
from hilbridge.learning import metrics
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.training.gate_fit import CAP, GATE, calibrate, fit_map, fit_maps, replays
from hilbridge.learning.training.replay import Watched, mapped, watch
from hilbridge.verbs import VERBS

K = len(VERBS)


def world(seed: int, people: int, steps: int = 1_500, heat: float = 2.5) -> tuple[Stream, np.ndarray]:
    """Intentions that last seconds, logits that are hot, and slow to leave the last intention."""
    rng = np.random.default_rng(seed)
    logits, labels = np.zeros((people * steps, K)), np.zeros(people * steps, dtype=np.int64)
    event = np.zeros(people * steps, dtype=np.int64)
    at = 0
    while at < people * steps:
        length = int(rng.integers(40, 120))
        verb = int(rng.integers(0, 3))
        shown = verb if rng.uniform() < 0.6 else int(rng.integers(0, 3))
        logits[at + 12 : at + length + 12, shown] += rng.uniform(0.2, 2.0)
        labels[at : at + length] = verb
        event[at : at + length] = at if rng.uniform() < 0.8 else -1
        at += length
    logits += rng.normal(0.0, 0.3, size=logits.shape)
    subject = np.repeat(np.arange(people), steps)
    minus = np.full(people * steps, -1)
    stream = Stream(
        subject,
        np.zeros((people * steps, D), np.float32),
        np.ones((people * steps, 3), bool),
        labels[: people * steps],
        minus,
        event,
        minus,
        minus,
        np.zeros((people * steps, K), np.float32),
        np.ones(people * steps, bool),
    )
    return stream, heat * logits


def test_h6_a_threshold_is_a_claim_that_holds_on_people_not_seen() -> None:
    stream, logits = world(0, 40)
    fitted = calibrate([logits], stream, ((),))
    assert len(fitted.curve) >= 3
    confidence = np.concatenate(
        [mapped(turn.gate.maps, turn.seen.probability, turn.seen.condition)[turn.seen.able] for turn in fitted.turns]
    )
    right = np.concatenate([turn.stream.right(turn.seen.candidate)[turn.seen.able] for turn in fitted.turns])
    assert metrics.ece(confidence, right) <= 0.03
    for point in fitted.curve:
        if point.coverage >= 0.02:
            assert point.precision >= point.tau_on - 0.05
            done = replays(fitted.turns, point.tau_on)
            claimed = np.concatenate([one.confidence[one.judged] for one in done]).mean()
            assert abs(claimed - point.precision) <= 0.05


def test_what_was_never_measured_is_never_acted_on() -> None:
    stream, logits = world(1, 6)
    fitted = calibrate([logits], stream, ((),))
    assert set(fitted.maps.by_condition) == set(MASKS)
    assert fitted.maps.confidence(1.0, 7) > 0.3
    for mask in MASKS:
        assert mask == 7 or fitted.maps.highest(mask) == 0.0
    assert fitted.maps.highest(condition_of(7, 1)) == 0.0


def test_a_level_of_tremor_needs_a_minute_to_be_measured() -> None:
    stream, _ = world(2, 2)
    steps = len(stream)
    under = np.full(steps, condition_of(7))
    under[:1_000] = condition_of(7, 1)
    under[1_000:2_600] = condition_of(7, 2)
    under[2_600:2_700] = 0  # nothing was valid in half of the window
    able = np.ones(steps, bool)
    smoothed = np.full((steps, K), 0.01)
    smoothed[:, 0] = np.linspace(0.1, 0.9, steps)
    seen = Watched(smoothed, np.zeros(steps, dtype=np.int64), able, ~able, under)
    assert set(fit_maps([(seen, stream)]).by_condition) == {condition_of(7), condition_of(7, 2)}


def test_a_map_rises_and_a_few_lucky_ticks_never_claim_certainty() -> None:
    probability = np.linspace(0.2, 0.99, 3_000)
    made = fit_map(probability, np.ones(3_000, dtype=bool))
    assert max(made.y) <= CAP
    assert list(made.y) == sorted(made.y)
    assert made(0.0) == 0.0
    assert fit_map(np.array([]), np.array([], dtype=bool))(1.0) == 0.0


def test_a_gate_that_never_acts_is_said() -> None:
    stream, logits = world(3, 3)
    with pytest.raises(ValueError, match="never acts"):
        calibrate([np.full_like(logits, np.nan)], stream, ((),))


def test_what_is_usual_for_people_raises_no_alarm_of_others_like_them_and_one_of_others_unlike_them() -> None:
    stream, logits = world(0, 40)
    fitted = calibrate([logits], stream, ((),))
    usual = fitted.usual
    assert usual is not None
    assert usual.condition == condition_of(7)
    assert 0.0 < usual.low < usual.high < 1.0

    def raised(logits: np.ndarray, stream: Stream) -> int:
        under = np.full(len(stream), condition_of(7))
        seen = watch(logits, under, stream.subject, fitted.temperatures, GATE)
        confidence = mapped(fitted.maps, seen.probability, seen.condition)
        alarms = 0
        for person in np.unique(stream.subject):
            drift = ConfidenceDrift(usual)
            for one in np.tile(confidence[(stream.subject == person) & ~seen.vetoed], 20):
                drift.update(float(one), condition_of(7))
            alarms += drift.raised is not None
        return alarms

    others, theirs = world(9, 20)
    assert raised(theirs, others) <= 2
    assert raised(0.0 * theirs, others) == 20
    assert calibrate([world(1, 3)[1]], world(1, 3)[0], ((),)).usual is None  # three people are too few to say
