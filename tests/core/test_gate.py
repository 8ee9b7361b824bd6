"""core.gate: default deny, named reasons, hysteresis, refractory, and what they may never delay (H1, H6, H7, H8)."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.confidence import ConfidenceMaps, RisingMap
from hilbridge.core import gate
from hilbridge.core.gate import GateConfig, GateState
from hilbridge.limits import MS
from hilbridge.records import Action, GateDecision, HoldReason, IntentEstimate
from hilbridge.verbs import NEVER_ASSISTED, OTHER, VERBS

TAKE, PUT, OPEN, CUT, MOVE = 0, 1, 2, 3, 4
TICK = 40 * MS
CONFIG = GateConfig(tau_on=0.7, tau_off=0.5, alpha=1.0, refractory_ns=200 * MS)


def estimate(
    now_ns: int, verb: int = TAKE, confidence: float = 0.9, age_ns: int = 20 * MS, k: int = len(VERBS)
) -> IntentEstimate:
    rest = (1.0 - confidence) / (k - 1)
    probabilities = tuple(confidence if index == verb else rest for index in range(k))
    return IntentEstimate(now_ns - age_ns, now_ns, probabilities, verb, confidence, 7, (True, True, True))


def run(
    config: GateConfig, rows: list[IntentEstimate | None], state: GateState | None = None, start_ns: int = 0
) -> tuple[GateState, list[GateDecision]]:
    state = state or GateState()
    decisions = []
    for index, row in enumerate(rows):
        state, decision = gate.step(config, state, row, start_ns + index * TICK)
        decisions.append(decision)
    return state, decisions


def acting(verb: int = TAKE, now_ns: int = 0) -> GateState:
    state, decision = gate.step(CONFIG, GateState(), estimate(now_ns, verb), now_ns)
    assert decision == GateDecision(Action.ACT, verb, pytest.approx(0.9), HoldReason.NONE)
    return state


def test_h1_nothing_known_means_hold() -> None:
    state, decision = gate.step(CONFIG, GateState(), None, 0)
    assert decision == GateDecision(Action.HOLD, None, 0.0, HoldReason.NO_ESTIMATE)
    assert state == GateState()


def test_acts_at_tau_on_and_holds_just_below() -> None:
    at_threshold = gate.step(CONFIG, GateState(), estimate(0, confidence=0.7), 0)[1]
    below = gate.step(CONFIG, GateState(), estimate(0, confidence=math.nextafter(0.7, 0)), 0)[1]
    assert (at_threshold.action, at_threshold.verb_index) == (Action.ACT, TAKE)
    assert (below.action, below.reason) == (Action.HOLD, HoldReason.CONFIDENCE)
    assert below.confidence == pytest.approx(0.7)


def test_hysteresis_keeps_acting_down_to_tau_off() -> None:
    state = acting()
    later = CONFIG.refractory_ns
    kept = gate.step(CONFIG, state, estimate(later, confidence=0.5), later)[1]
    left = gate.step(CONFIG, state, estimate(later, confidence=math.nextafter(0.5, 0)), later)[1]
    assert kept.action is Action.ACT
    assert (left.action, left.verb_index, left.reason) == (Action.HOLD, None, HoldReason.CONFIDENCE)


def test_h7_refractory_delays_confidence_in_both_directions() -> None:
    state = acting()
    inside = CONFIG.refractory_ns - 1
    still, decision = gate.step(CONFIG, state, estimate(inside, confidence=0.1), inside)
    assert decision.action is Action.ACT
    assert decision.verb_index == TAKE
    assert decision.confidence == pytest.approx(0.1)
    left, decision = gate.step(CONFIG, still, estimate(inside + 1, confidence=0.1), inside + 1)
    assert decision.action is Action.HOLD
    assert left.switched_ns == inside + 1
    again = inside + 2
    held, decision = gate.step(CONFIG, left, estimate(again), again)
    assert (decision.action, decision.reason) == (Action.HOLD, HoldReason.REFRACTORY)
    free = left.switched_ns + CONFIG.refractory_ns
    assert gate.step(CONFIG, held, estimate(free), free)[1].action is Action.ACT


@pytest.mark.parametrize("veto", [reason for reason in HoldReason if reason is not HoldReason.NONE])
def test_h2_a_veto_acts_at_once_inside_the_refractory(veto: HoldReason) -> None:
    state, decision = gate.step(CONFIG, acting(), estimate(1), 1, veto)
    assert decision == GateDecision(Action.HOLD, None, 0.0, veto)
    assert (state.action, state.verb_index, state.switched_ns) == (Action.HOLD, None, 1)


@pytest.mark.parametrize(
    "row",
    [
        None,
        replace(estimate(1), confidence=math.nan),
        replace(estimate(1), confidence=1.1),
        replace(estimate(1), confidence=-0.1),
        replace(estimate(1), probabilities=(math.nan, *estimate(1).probabilities[1:])),
        replace(estimate(1), probabilities=(math.inf, *estimate(1).probabilities[1:])),
        replace(estimate(1), verb_index=-1),
        replace(estimate(1), verb_index=len(VERBS)),
        replace(estimate(1), probabilities=()),
    ],
)
def test_unusable_estimates_hold_at_once_and_forget(row: IntentEstimate | None) -> None:
    state, decision = gate.step(CONFIG, acting(), row, 1)
    assert (decision.action, decision.reason) == (Action.HOLD, HoldReason.NO_ESTIMATE)
    assert (state.smoothed, state.last_produced_ns) == ((), None)


@pytest.mark.parametrize("row", [None, replace(estimate(1), confidence=math.nan)])
def test_no_veto_saves_an_unusable_estimate(row: IntentEstimate | None) -> None:
    state, decision = gate.step(CONFIG, acting(), row, 1, HoldReason.NOT_ARMED)
    assert decision.reason is HoldReason.NOT_ARMED
    assert (state.smoothed, state.last_produced_ns) == ((), None)


@pytest.mark.parametrize(
    ("age_ns", "reason"),
    [
        (0, HoldReason.NONE),
        (150 * MS, HoldReason.NONE),
        (150 * MS + 1, HoldReason.STALE),
        (-1, HoldReason.STALE),
        (10**15, HoldReason.STALE),
    ],
)
def test_h8_age_of_the_oldest_input(age_ns: int, reason: HoldReason) -> None:
    state, decision = gate.step(CONFIG, acting(), estimate(1, age_ns=age_ns), 1)
    assert decision.reason is reason
    assert (state.smoothed == ()) is (reason is HoldReason.STALE)


def test_estimate_too_old_now_holds_although_it_was_fresh_when_made() -> None:
    made = estimate(0)
    assert gate.step(CONFIG, acting(), made, 131 * MS)[1].reason is HoldReason.STALE


def test_verb_change_passes_through_hold_and_the_refractory() -> None:
    state = acting(TAKE)
    now = CONFIG.refractory_ns
    state, decision = gate.step(CONFIG, state, estimate(now, PUT), now)
    assert (decision.action, decision.reason) == (Action.HOLD, HoldReason.VERB_CHANGE)
    now += TICK
    state, decision = gate.step(CONFIG, state, estimate(now, PUT), now)
    assert decision.reason is HoldReason.REFRACTORY
    now += CONFIG.refractory_ns
    assert gate.step(CONFIG, state, estimate(now, PUT), now)[1].verb_index == PUT


def test_h1_verbs_the_device_never_assists_hold() -> None:
    for verb in NEVER_ASSISTED:
        assert gate.step(CONFIG, GateState(), estimate(0, verb, 1.0), 0)[1].reason is HoldReason.VERB_NOT_ASSISTED
    assert {MOVE, OTHER} == NEVER_ASSISTED


def test_top_k_filter_looks_at_the_newest_window() -> None:
    config = GateConfig(tau_on=0.3, tau_off=0.2, alpha=0.2, top_k=3, refractory_ns=0)
    state, _ = run(config, [estimate(i * TICK, TAKE, 0.95) for i in range(10)])
    now = 10 * TICK
    wanders = replace(estimate(now), probabilities=(0.1, 0.4, 0.3, 0.2) + (0.0,) * 17, verb_index=PUT, confidence=0.4)
    assert state.verb_index == TAKE
    assert gate.step(config, state, wanders, now)[1].reason is HoldReason.NOT_TOP_K
    tied = replace(wanders, probabilities=(0.2, 0.4, 0.2, 0.2) + (0.0,) * 17)
    assert gate.step(config, state, tied, now)[1].action is Action.ACT


def test_the_first_sample_counts_fully_and_later_ones_by_alpha() -> None:
    config = replace(CONFIG, alpha=0.2)
    state, decisions = run(config, [estimate(0, TAKE, 0.9), *(estimate(i * TICK, TAKE, 0.4) for i in range(1, 4))])
    assert decisions[0].action is Action.ACT
    assert state.smoothed[TAKE] == pytest.approx(0.4 + 0.5 * 0.8**3)


def test_the_same_estimate_is_smoothed_once() -> None:
    config = replace(CONFIG, alpha=0.2)
    state, _ = run(config, [estimate(0, TAKE, 0.2)])
    only = estimate(TICK, TAKE, 1.0, age_ns=0)
    for now in range(TICK, 150 * MS, MS):
        state, decision = gate.step(config, state, only, now)
        assert decision.action is Action.HOLD
    assert state.smoothed[TAKE] == pytest.approx(0.36)


@pytest.mark.parametrize("veto", [None, *(reason for reason in HoldReason if reason is not HoldReason.NONE)])
def test_h8_belief_is_forgotten_in_a_gap_of_sensing_whichever_veto_is_named(veto: HoldReason | None) -> None:
    config = replace(CONFIG, alpha=0.2)
    state, _ = run(config, [estimate(i * TICK, TAKE, 1.0) for i in range(5)])
    now = 5 * TICK
    seeing, _ = gate.step(config, state, estimate(now, TAKE, 1.0), now, veto)
    blind, held = gate.step(config, state, estimate(now, TAKE, 1.0), now, veto, blind=HoldReason.OVERRUN)
    stale, _ = gate.step(config, state, estimate(now, TAKE, 1.0, age_ns=200 * MS), now, veto)
    assert seeing.smoothed[TAKE] == pytest.approx(1.0)
    assert (blind.smoothed, stale.smoothed) == ((), ())
    assert held.reason is (veto or HoldReason.OVERRUN)


def test_another_number_of_classes_starts_the_belief_anew() -> None:
    state, _ = run(replace(CONFIG, alpha=0.5), [estimate(0, TAKE, 0.9)])
    state, _ = gate.step(replace(CONFIG, alpha=0.5), state, estimate(TICK, TAKE, 0.9, k=5), TICK)
    assert len(state.smoothed) == 5
    assert state.smoothed[TAKE] == pytest.approx(0.9)


MAPS = ConfidenceMaps({7: RisingMap((0.0, 0.5, 1.0), (0.0, 0.1, 0.8)), 3: RisingMap((0.0, 1.0), (0.0, 0.6))})


def under(condition: int | None, probability: float) -> GateDecision:
    row = replace(estimate(0, TAKE, probability), condition=condition)
    return gate.step(replace(CONFIG, maps=MAPS), GateState(), row, 0)[1]


def test_thresholds_are_compared_with_what_the_map_of_the_condition_makes_of_it() -> None:
    assert under(None, 0.9) == GateDecision(Action.ACT, TAKE, 0.9, HoldReason.NONE)
    assert under(7, 0.9).confidence == pytest.approx(0.1 + 0.8 * 0.7)
    assert under(7, 0.9).reason is HoldReason.CONFIDENCE
    assert under(7, 0.95).action is Action.ACT
    assert under(3, 1.0).confidence == pytest.approx(0.6)


def test_h1_a_condition_that_nobody_measured_is_never_acted_on() -> None:
    assert under(5, 1.0) == GateDecision(Action.HOLD, None, 0.0, HoldReason.CONFIDENCE)


def test_what_is_reported_while_a_switch_waits_is_the_assisted_verbs_confidence() -> None:
    config = replace(CONFIG, maps=MAPS)
    state, _ = gate.step(config, GateState(), replace(estimate(0, TAKE, 0.95), condition=7), 0)
    other = replace(estimate(1, PUT, 0.8), condition=7)
    _, decision = gate.step(config, state, other, 1)
    assert (decision.action, decision.verb_index) == (Action.ACT, TAKE)
    assert decision.confidence == pytest.approx(0.2 * 0.01, abs=1e-3)


def test_the_settings_of_a_gate_are_plain_numbers() -> None:
    settings = replace(CONFIG, maps=MAPS).settings()
    assert settings["tau_on"] == 0.7
    assert all(isinstance(value, int | float) for value in settings.values())


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"tau_on": 0.0}, "tau_on"),
        ({"tau_on": 1.01}, "tau_on"),
        ({"tau_on": math.nan}, "tau_on"),
        ({"tau_off": 0.7}, "tau_off"),
        ({"tau_off": -0.1}, "tau_off"),
        ({"alpha": 0.0}, "alpha"),
        ({"alpha": 1.1}, "alpha"),
        ({"top_k": 0}, "top_k"),
        ({"refractory_ns": -1}, "refractory_ns"),
        ({"max_age_ns": 0}, "max_age_ns"),
        ({"max_age_ns": 150 * MS + 1}, "max_age_ns"),
    ],
)
def test_config_refuses_what_is_unsafe_or_senseless(changes: dict[str, float], field: str) -> None:
    with pytest.raises(ValueError, match=f"^{field} = "):
        replace(CONFIG, **changes)  # type: ignore[arg-type]


def test_config_accepts_its_limits() -> None:
    replace(CONFIG, tau_on=1.0, tau_off=0.0, alpha=1.0, top_k=1, refractory_ns=0, max_age_ns=150 * MS)
    replace(CONFIG, max_age_ns=1)
    assert GateConfig(0.8, 0.6) == GateConfig(0.8, 0.6, 0.2, 3, 240 * MS, 150 * MS)


TICKS = st.lists(
    st.tuples(
        st.integers(0, 5),
        st.floats(0.0, 1.0),
        st.integers(-10, 300),
        st.sampled_from([None, None, None, HoldReason.NOT_ARMED, HoldReason.SENSOR_MISSING]),
        st.integers(1, 90),
    ),
    max_size=60,
)


@given(TICKS, st.floats(0.05, 1.0), st.integers(0, 500))
def test_h1_h7_properties_hold_on_any_stream(
    ticks: list[tuple[int, float, int, HoldReason | None, int]], alpha: float, refractory_ms: int
) -> None:
    config = GateConfig(0.6, 0.4, alpha=alpha, refractory_ns=refractory_ms * MS)
    state, now, last_switch, was = GateState(), 0, None, Action.HOLD
    for verb, confidence, age_ms, veto, gap_ms in ticks:
        now += gap_ms * MS
        before = state
        state, decision = gate.step(config, state, estimate(now, verb, confidence, age_ms * MS), now, veto)
        assert (decision.action is Action.ACT) == (decision.reason is HoldReason.NONE)
        assert (decision.action is Action.ACT) == (decision.verb_index is not None)
        assert state.action is decision.action
        if decision.action is Action.ACT:
            assert veto is None
            assert 0 <= age_ms <= 150
            assert decision.verb_index not in NEVER_ASSISTED
            if was is Action.HOLD:
                assert decision.confidence >= config.tau_on
                assert last_switch is None or now - last_switch >= config.refractory_ns
            else:
                assert decision.verb_index == before.verb_index
        if decision.action is not was:
            last_switch = now
        was = decision.action
