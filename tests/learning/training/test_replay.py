"""The replay over whole streams is the live gate, tick by tick."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("torch")

from hilbridge.confidence import MASKS, ConfidenceMaps, RisingMap
from hilbridge.core import gate
from hilbridge.core.gate import GateConfig, GateState
from hilbridge.core.right import is_right
from hilbridge.core.sensing import Sensing
from hilbridge.features.layout import STEP_NS, D
from hilbridge.intent.calibration import softmax
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.training.replay import replay, watch, window_masks
from hilbridge.limits import MS
from hilbridge.records import Action, HoldReason, IntentEstimate
from hilbridge.verbs import VERBS

K = len(VERBS)
MAPS = ConfidenceMaps({mask: RisingMap((0.0, 0.3, 1.0), (0.0, 0.1 + 0.05 * mask, 0.9)) for mask in MASKS})
TEMPERATURES = {mask: 0.5 + 0.1 * mask for mask in MASKS}


def drawn(seed: int, steps: int) -> tuple[Stream, np.ndarray, np.ndarray]:
    """A stream of two people with belief that wanders, gaps and changing masks."""
    rng = np.random.default_rng(seed)
    verbs = np.repeat(rng.integers(0, 5, size=steps // 9 + 1), 9)[:steps]
    logits = rng.normal(0.0, 1.0, size=(steps, K))
    logits[np.arange(steps), verbs] += rng.uniform(0.0, 6.0, size=steps)
    for start in rng.integers(0, steps, size=3):
        logits[start : start + rng.integers(1, 8)] = np.nan
    subject = np.where(np.arange(steps) < steps // 2, 4, 9)
    event = np.where(rng.uniform(size=steps) < 0.7, np.arange(steps) // 9, -1)
    current = np.where(rng.uniform(size=steps) < 0.4, rng.integers(0, 5, size=steps), -1)
    minus = np.full(steps, -1)
    stream = Stream(
        subject,
        np.zeros((steps, D), np.float32),
        rng.uniform(size=(steps, 3)) < 0.6,
        verbs,
        current,
        event,
        minus,
        minus,
        np.zeros((steps, K), np.float32),
        np.ones(steps, dtype=bool),
    )
    return stream, logits, rng.integers(1, 8, size=steps)


def live(config: GateConfig, stream: Stream, logits: np.ndarray, masks: np.ndarray) -> list[tuple[int, float]]:
    """What the gate itself decides, with trust in sensing earned as in the running bridge."""
    state, sensing, made = GateState(), Sensing(), []
    for index, row in enumerate(logits):
        now_ns = index * STEP_NS
        if index and stream.subject[index] != stream.subject[index - 1]:
            state, sensing = GateState(), Sensing()
        belief, gap = None, HoldReason.NO_ESTIMATE
        if not np.isnan(row[0]):
            probabilities = softmax(row / TEMPERATURES[int(masks[index])])
            top = int(probabilities.argmax())
            belief = IntentEstimate(
                now_ns,
                now_ns,
                tuple(probabilities.tolist()),
                top,
                float(probabilities[top]),
                0,
                (True, True, True),
                int(masks[index]),
            )
            gap = None
        sensing = sensing.step(gap, now_ns)
        state, decision = gate.step(config, state, belief, now_ns, sensing.objection(now_ns), blind=gap)
        acting = decision.action is Action.ACT and decision.verb_index is not None
        made.append((decision.verb_index if acting else -1, decision.confidence if acting else 0.0))
    return made


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 10_000),
    st.floats(0.2, 0.9),
    st.floats(0.01, 0.15),
    st.integers(0, 400),
    st.sampled_from([0.2, 0.5, 1.0]),
)
def test_the_replay_decides_as_the_live_gate(seed: int, tau_on: float, band: float, rest_ms: int, alpha: float) -> None:
    stream, logits, masks = drawn(seed, 160)
    config = GateConfig(tau_on, tau_on - band, alpha=alpha, refractory_ns=rest_ms * MS, maps=MAPS)
    done = replay(config, watch(logits, masks, stream.subject, TEMPERATURES, config), stream)
    expected = live(config, stream, logits, masks)
    assert done.verb.tolist() == [verb for verb, _ in expected]
    assert done.confidence == pytest.approx([confidence for _, confidence in expected], abs=1e-9)


def test_a_stream_is_right_where_the_one_label_says_so() -> None:
    stream, _, _ = drawn(3, 200)
    verbs = np.random.default_rng(1).integers(-1, 5, size=200)

    def known(value: int) -> int | None:
        return None if value < 0 else value

    prepared = [int(label) if event >= 0 else None for label, event in zip(stream.label, stream.event, strict=True)]
    expected = [
        verb >= 0 and is_right(int(verb), known(int(current)), soon)
        for verb, current, soon in zip(verbs, stream.current, prepared, strict=True)
    ]
    assert stream.right(verbs).tolist() == expected


def test_a_veto_holds_at_once_and_what_nobody_knows_is_not_judged() -> None:
    stream, logits, masks = drawn(5, 160)
    config = GateConfig(0.2, 0.1, maps=MAPS)
    veto = np.zeros(160, dtype=bool)
    veto[40:50] = True
    free = replay(config, watch(logits, masks, stream.subject, TEMPERATURES, config), stream)
    held = replay(config, watch(logits, masks, stream.subject, TEMPERATURES, config, veto), stream)
    assert free.acting[40:50].any()
    assert not held.acting[40:50].any()
    unknown = replay(
        config,
        watch(logits, masks, stream.subject, TEMPERATURES, config),
        replace(stream, known=np.zeros(160, dtype=bool)),
    )
    assert unknown.coverage == 0.0
    assert np.isnan(unknown.act_only_precision)
    assert unknown.figures.judged_ticks == 0


def test_masks_of_windows_are_those_of_the_predictor() -> None:
    stream, _, _ = drawn(8, 160)
    masks = window_masks(stream)
    for index in (0, 3, 49, 79, 80, 130, 159):
        first = 80 if index >= 80 else 0
        window = stream.valid[max(first, index - 49) : index + 1]
        assert masks[index] == sum(1 << bit for bit in range(3) if 2 * window[:, bit].sum() >= len(window))
