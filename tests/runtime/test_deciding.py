"""runtime.deciding: told what a recording keeps of each tick, it decides as the node on its bus does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hilbridge.confidence import ConfidenceMaps, RisingMap, condition_of
from hilbridge.core.bridge import Command
from hilbridge.core.gate import GateConfig
from hilbridge.features.layout import D
from hilbridge.limits import MS, TICK_NS
from hilbridge.records import Action, FeatureVector, HoldReason, IntentEstimate
from hilbridge.runtime.deciding import Decider, Told, decided
from hilbridge.verbs import VERBS

SEEN = (True, True, True)
GATE = GateConfig(tau_on=0.6, tau_off=0.4, alpha=0.6)
AT_REST = Command(Action.HOLD, "None", HoldReason.NO_ESTIMATE, 0)


class Sure:
    """Believes in one verb from the first features on."""

    def __init__(self) -> None:
        self.resets = 0

    def step(self, vector: FeatureVector, produced_ns: int) -> IntentEstimate:
        probabilities = tuple(0.98 if verb == 0 else 0.001 for verb in range(len(VERBS)))
        return IntentEstimate(vector.oldest_input_ns, produced_ns, probabilities, 0, 0.95, 1, vector.valid)

    def reset(self) -> None:
        self.resets += 1


class Measured(Sure):
    """Believes as the predictor does: what it says has to be put through a map."""

    def step(self, vector: FeatureVector, produced_ns: int) -> IntentEstimate:
        return replace(super().step(vector, produced_ns), condition=condition_of(7))


class Calm:
    def __init__(self) -> None:
        self.level = 0

    def update(self, vector: FeatureVector) -> int:
        return self.level


def told(tick: int, **changed: object) -> Told:
    now_ns = 1_000 * MS + tick * TICK_NS
    vector = FeatureVector(now_ns - 20 * MS, now_ns - 15 * MS, np.zeros(D, np.float32), SEEN)
    return Told(vector, None, HoldReason.NONE, False, now_ns)._replace(**changed)


def run(decider: Decider, ticks: list[Told]) -> list[tuple[Action, HoldReason]]:
    before, found = AT_REST, []
    for tick in ticks:
        decision, before = decided(decider, tick, before)
        found.append((decision.action, decision.reason))
    return found


def test_it_acts_when_sensing_was_whole_for_long_enough() -> None:
    found = run(Decider(Sure(), GATE, Calm()), [told(tick) for tick in range(20)])
    assert found[0] == (Action.HOLD, HoldReason.WARMING_UP)
    assert found[-1] == (Action.ACT, HoldReason.NONE)


def test_each_reason_from_outside_holds_and_has_its_rank() -> None:
    ticks = [told(tick) for tick in range(20)]
    for changed, reason in (
        ({"outside": HoldReason.NOT_ARMED}, HoldReason.NOT_ARMED),
        ({"problem": "gaze is gone"}, HoldReason.SENSOR_MISSING),
        ({"overrun": True}, HoldReason.OVERRUN),
        ({"overrun": True, "problem": "x", "outside": HoldReason.STOPPED}, HoldReason.STOPPED),
        ({"vector": None, "now_ns": told(20).now_ns + 400 * MS}, HoldReason.STALE),
    ):
        assert run(Decider(Sure(), GATE, Calm()), [*ticks, told(20, **changed)])[-1] == (Action.HOLD, reason)


def test_tremor_holds_and_a_gap_between_features_starts_anew() -> None:
    guard, predictor = Calm(), Sure()
    decider = Decider(predictor, GATE, guard)
    run(decider, [told(tick) for tick in range(20)])
    guard.level = 1
    assert run(decider, [told(20)])[-1][1] is HoldReason.TREMOR
    guard.level = 0
    assert run(decider, [told(30)])[-1][1] is HoldReason.WARMING_UP
    assert predictor.resets == 1


def test_confidence_unlike_the_bundles_people_holds_until_the_bridge_starts_anew() -> None:
    maps = ConfidenceMaps({condition_of(7): RisingMap((0.0, 1.0), (0.0, 0.95))})
    gate = replace(GATE, maps=maps, usual=(0.2, 0.4, condition_of(7)))
    decider = Decider(Measured(), gate, Calm())
    ticks = [told(tick) for tick in range(25 * 600)]
    found = run(decider, ticks)
    assert decider.drift == "above"
    first = found.index((Action.HOLD, HoldReason.DRIFT))
    assert found[first - 1] == (Action.ACT, HoldReason.NONE)
    assert set(found[first:]) == {(Action.HOLD, HoldReason.DRIFT)}
    stopped = run(decider, [told(25 * 600, outside=HoldReason.STOPPED)])
    assert stopped == [(Action.HOLD, HoldReason.STOPPED)]  # it never goes before what somebody must act on
    assert run(Decider(Measured(), replace(gate, usual=(0.2, 0.99, 7)), Calm()), ticks)[-1][0] is Action.ACT


def test_what_cannot_be_believed_has_no_age() -> None:
    decider = Decider(Sure(), GATE, Calm())
    assert (decider.seeing, decider.oldest_input_ns, decider.valid) == (None, None, (False, False, False))
    decider.step(told(1))
    assert decider.oldest_input_ns == told(1).now_ns - 20 * MS
    assert decider.valid == SEEN
    decider.step(told(2, problem="camera is gone"))
    assert decider.oldest_input_ns is None


def test_h6_a_level_of_tremor_has_its_own_map_and_what_was_not_measured_holds_at_once() -> None:
    calm, shaky = RisingMap((0.0, 1.0), (0.0, 0.95)), RisingMap((0.0, 1.0), (0.0, 0.7))
    weak = RisingMap((0.0, 1.0), (0.0, 0.5))
    maps = ConfidenceMaps({condition_of(7): calm, condition_of(7, 1): shaky, condition_of(7, 2): weak})
    guard = Calm()
    decider = Decider(Measured(), replace(GATE, maps=maps), guard)
    assert run(decider, [told(tick) for tick in range(20)])[-1] == (Action.ACT, HoldReason.NONE)
    guard.level = 1
    assert run(decider, [told(20)])[-1] == (Action.ACT, HoldReason.NONE)
    assert not decider.tremor
    for level in (2, 3):  # no confidence under it reaches tau_on; nobody measured it
        guard.level = level
        assert run(decider, [told(18 + level * 2)])[-1] == (Action.HOLD, HoldReason.TREMOR)
        assert decider.tremor
