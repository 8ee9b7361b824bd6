"""runtime.node against the real device in virtual time: the whole chain but sensors and sockets, to the millisecond.

Frames cross a bus that takes a millisecond. Everything is deterministic: nonces are counted, no clock is read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.device import Device
from firmware_sim.memory import ControllerState, Received
from firmware_sim.states import State
from hilbridge.core.bridge import Bridge, BridgeConfig
from hilbridge.core.gate import GateConfig
from hilbridge.features.layout import D
from hilbridge.limits import EARN_NS, MS
from hilbridge.records import Action, FeatureVector, Frame, HoldReason, IntentEstimate
from hilbridge.runtime.health import SensorSeen
from hilbridge.runtime.node import BridgeNode, Tick
from hilbridge.verbs import VERBS
from hilbridge.wire.codec import Codec, Decoded
from hilbridge.wire.keys import DEMO_KEY
from hilbridge.wire.link import WireLink
from hilbridge.wire.secoc import Authenticator

POUR = VERBS.index("Pour")


class Sure:
    """A predictor that believes in Pour as firmly as it is told to."""

    def __init__(self) -> None:
        self.confidence = 0.97
        self.silent = False
        self.resets = 0

    def step(self, vector: FeatureVector, produced_ns: int) -> IntentEstimate | None:
        if self.silent:
            return None
        rest = (1.0 - self.confidence) / (len(VERBS) - 1)
        probabilities = tuple(self.confidence if index == POUR else rest for index in range(len(VERBS)))
        return IntentEstimate(
            vector.oldest_input_ns, produced_ns, probabilities, POUR, self.confidence, 1, vector.valid
        )

    def reset(self) -> None:
        self.resets += 1


class Shaking:
    """A tremor guard that says what it is told to."""

    value = False

    def update(self, vector: FeatureVector) -> bool:
        return self.value


class World:
    """Bridge node and device, stepped by the millisecond. `sees` is False while the camera is silent."""

    def __init__(self) -> None:
        self.now_ms = 0
        self.predict, self.guard = Sure(), Shaking()
        self.sees = self.hears = self.ticks = True
        self.felt: bool | None = None
        self.events: list[str] = []
        self.last: Tick | None = None
        wire = WireLink(Codec())
        nonces = count(1)
        bridge = Bridge(wire, Authenticator(DEMO_KEY), lambda: next(nonces), BridgeConfig(), lambda: wire.counters)
        config = GateConfig(tau_on=0.8, tau_off=0.6, alpha=1.0, refractory_ns=40 * MS)
        say: Callable[[int, str], None] = lambda now_ns, text: self.events.append(text)  # noqa: E731
        self.node = BridgeNode(self.predict, config, bridge, wire, 0x1234, self.guard, say)
        self.device = Device(ControllerState(DEMO_KEY, 77), "sway")
        self._to_device: list[Frame] = []
        self._to_bridge: list[tuple[int, bytes]] = []
        self._captured_ns = 0

    def run(self, milliseconds: int) -> Iterator[State]:
        for _ in range(milliseconds):
            self.now_ms += 1
            now_ns = self.now_ms * MS
            arriving, self._to_bridge = self._to_bridge, []
            if self.hears:
                for can_id, data in arriving:
                    self._to_device += self.node.receive(Frame(can_id, data, now_ns), now_ns)[1]
            if self.now_ms % 40 == 0 and self.ticks:
                self._tick(now_ns)
            frames, self._to_device = self._to_device, []
            received = tuple(Received(frame.can_id, frame.data, True) for frame in frames)
            self._to_bridge = list(self.device.tick(received, self.now_ms))
            yield self.device.state.state

    def _tick(self, now_ns: int) -> None:
        vector = None
        if self.sees:
            self._captured_ns = now_ns - 10 * MS
            values = np.full(D, 0.5, np.float32)
            vector = FeatureVector(self._captured_ns, self._captured_ns, values, (True, True, True))
        camera = SensorSeen("camera", True, self._captured_ns, self._captured_ns, 120 * MS, 150 * MS)
        self.last = self.node.tick(vector, (camera,), now_ns, self.felt)
        self._to_device += self.last.frames

    def until(self, state: State, limit_ms: int = 3000) -> int:
        """Milliseconds until the device is in `state`."""
        for elapsed, seen in enumerate(self.run(limit_ms), start=1):
            if seen == state:
                return elapsed
        raise AssertionError(f"never {state.name} within {limit_ms} ms; last {self.last}")

    @property
    def assist_unm(self) -> int:
        return self.device.state.torque.assist_unm

    @property
    def reason(self) -> HoldReason:
        assert self.last is not None
        return self.last.decision.reason


@pytest.fixture
def world() -> World:
    made = World()
    made.until(State.ASSIST)
    for _ in made.run(300):
        pass
    assert made.assist_unm != 0
    return made


def test_the_chain_arms_waits_for_neutral_and_assists() -> None:
    made = World()
    made.until(State.FOLLOW)
    made.until(State.READY)
    assert made.last is not None
    assert made.last.decision.action is Action.HOLD
    made.until(State.ASSIST, 200)
    assert made.last.decision.verb_index == POUR
    assert made.last.row.verb == "Pour"
    assert {"armed", "device: Ready", "no tremor in the hands"} <= set(made.events)


def test_h8_silent_camera_ends_in_follow_in_time(world: World) -> None:
    world.sees = False
    act_ms = world.now_ms
    until_follow = world.until(State.FOLLOW, 400)
    assert world.reason is HoldReason.SENSOR_MISSING
    assert world.assist_unm == 0
    # 120 ms until the camera counts as silent, at most one tick, and the ramp.
    assert until_follow <= 120 + 40 + 60
    assert world.device.state.command_ms - act_ms <= 200


def test_h2_hung_bridge_ends_in_follow_within_150_ms_of_its_last_command(world: World) -> None:
    world.ticks = False
    world.until(State.FOLLOW, 400)
    assert world.now_ms - world.device.state.command_ms <= 150
    assert world.assist_unm == 0


def test_deaf_bridge_holds_for_a_silent_device(world: World) -> None:
    world.hears = False
    for _ in world.run(120):
        pass
    assert world.reason is HoldReason.DEVICE_SILENT
    assert world.assist_unm == 0


def test_h6_tremor_is_a_veto_by_name(world: World) -> None:
    world.guard.value = True
    world.until(State.READY, 200)
    assert world.reason is HoldReason.TREMOR
    assert "tremor in the hands" in world.events


def test_h6_a_tremor_that_is_only_felt_is_the_same_veto(world: World) -> None:
    world.felt = True
    world.until(State.READY, 200)
    assert world.reason is HoldReason.TREMOR
    assert world.last is not None
    assert (world.last.row.tremor, world.last.row.felt_tremor) == (False, True)
    assert "tremor in the hands" in world.events
    world.felt = False
    world.until(State.ASSIST, 2000)
    assert "no tremor in the hands" in world.events


def test_lost_confidence_goes_back_to_ready_not_to_follow(world: World) -> None:
    world.predict.confidence = 0.3
    seen = set(world.run(300))
    assert State.FOLLOW not in seen
    assert world.device.state.state == State.READY
    assert world.reason is HoldReason.CONFIDENCE


def test_silent_predictor_warms_up_by_name(world: World) -> None:
    world.predict.silent = True
    world.until(State.READY, 200)
    assert world.reason is HoldReason.WARMING_UP


def test_an_overrun_holds_that_tick_and_tells_the_device(world: World) -> None:
    world.ticks = False
    for _ in world.run(79):
        pass
    world.ticks = True
    overruns = world.node.bridge.diag["Overruns"]
    world.until(State.FOLLOW, 200)
    assert world.node.bridge.diag["Overruns"] == overruns + 1
    world.until(State.ASSIST, 1000)


def test_a_gap_in_the_pictures_starts_the_window_anew(world: World) -> None:
    before = world.predict.resets
    world.sees = False
    for _ in world.run(400):
        pass
    world.sees = True
    world.until(State.ASSIST, 1000)
    assert world.predict.resets == before + 1


def test_every_tick_sends_its_command_first_and_says_why_it_held(world: World) -> None:
    wire = world.node.wire.codec
    for _ in range(50):
        for _ in world.run(40):
            pass
        assert world.last is not None
        names = [wire.by_id[frame.can_id].name for frame in world.last.frames]
        assert names[0] == "ACT_CMD"
        acting = world.last.decision.action is Action.ACT
        assert ("ACT_AUTH" in names) is acting
        assert (world.reason is HoldReason.NONE) is acting


def test_a_device_with_another_key_is_told_once_with_the_cure() -> None:
    world = World()
    world.device = Device(ControllerState(b"another key here", 78), "sway")
    for _ in world.run(6000):
        pass
    told = [text for text in world.events if "rejects our key" in text]
    assert told == ["not armed: the device rejects our key; give both the same key file, then start the device anew"]
    assert world.last is not None
    assert world.last.decision.reason is HoldReason.NOT_ARMED


def test_h8_h9_the_reason_names_the_sensor_while_it_is_away_and_while_trust_is_earned(world: World) -> None:
    world.sees = False
    world.until(State.FOLLOW, 400)
    for _ in world.run(1000):
        assert world.reason is HoldReason.SENSOR_MISSING  # not the device, which follows because of it
    world.sees = True
    back_ms = world.now_ms
    for _ in world.run(400):
        assert world.reason is HoldReason.SENSOR_MISSING
    world.until(State.ASSIST, 400)
    assert world.now_ms - back_ms >= EARN_NS // MS


def test_the_heartbeat_tells_which_sensor_fails_and_the_command_that_nothing_may_rest_on_it(world: World) -> None:
    told: list[tuple[int, int]] = []
    for _ in range(20):
        world.now_ms += 40
        now_ns = world.now_ms * MS
        vector = FeatureVector(now_ns, now_ns, np.full(D, 0.5, np.float32), (True, True, True))
        sensors = [SensorSeen(name, name != "gaze", now_ns, now_ns, 120 * MS) for name in ("camera", "gaze")]
        frames = world.node.tick(vector, tuple(sensors), now_ns).frames
        act_cmd = Codec().decode(frames[0])
        assert isinstance(act_cmd, Decoded)
        told += [(frame.data[3] & 7, act_cmd.signals["SensingAge"]) for frame in frames if frame.can_id == 0x120]
    assert set(told) == {(0b110, 510)}


FAULTS = {
    "camera": ("sees", False),
    "bus": ("hears", False),
    "loop": ("ticks", False),
    "predictor": ("silent", True),
    "tremor": ("value", True),
}


@settings(max_examples=10)
@given(
    st.lists(
        st.tuples(st.sets(st.sampled_from(sorted(FAULTS)), max_size=3), st.integers(1, 12).map(lambda n: 40 * n)),
        min_size=1,
        max_size=8,
    )
)
def test_h8_no_order_of_faults_makes_an_act_come_sooner(sequence: list[tuple[set[str], int]]) -> None:
    world = World()
    world.until(State.ASSIST)
    assert world.last is not None
    gap_ms, last_row = 0, world.last.row
    for faults, milliseconds in [*sequence, (set(), 1200)]:
        for name, (attribute, value) in FAULTS.items():
            part = {"predictor": world.predict, "tremor": world.guard}.get(name, world)
            setattr(part, attribute, value if name in faults else not value)
        for _ in world.run(milliseconds):
            assert world.last is not None
            row = world.last.row
            if row is last_row:
                continue
            last_row = row
            silent = "predictor" in faults and row.new_features  # it is asked only where there are features
            if row.sensor_problem or silent or world.node.bridge.overrun:
                gap_ms = world.now_ms
            if row.action is Action.ACT:
                assert world.now_ms - gap_ms >= EARN_NS // MS
            if row.sensor_problem and row.reason not in (HoldReason.OVERRUN, HoldReason.DEVICE_FAULT):
                assert row.reason is HoldReason.SENSOR_MISSING


def test_only_a_frame_that_this_bridge_alone_may_send_is_anothers() -> None:
    made, other = World(), WireLink(Codec())
    for frame in (Frame(0x700, b"12345678"), Frame(0x0A0, b""), Frame(0x001, b"", is_error=True)):
        made.node.receive(frame, 1)
    assert made.node.foreign == 0  # a site has nodes of its own; they are no second bridge
    for name in ("ACT_CMD", "BRIDGE_HB", "ARM_REQUEST"):
        made.node.receive(other.encode(name, {}), 1)
    assert made.node.foreign == 3


@pytest.mark.parametrize(("bound_ns", "said"), [(3_400_000, 3400), (None, 0xFFFFFFFF), (10**18, 0xFFFFFFFF)])
def test_how_well_a_clock_is_known_is_said_on_the_bus(world: World, bound_ns: int | None, said: int) -> None:
    seen: dict[str, int] = {}
    device = WireLink(Codec(), node="CONTROLLER")

    def listen(milliseconds: int) -> None:
        for _ in world.run(milliseconds):
            for frame in () if world.now_ms % 40 or world.last is None else world.last.frames:
                decoded = device.decode(frame)
                if isinstance(decoded, Decoded) and decoded.name == "BRIDGE_DIAG":
                    index = str(decoded.signals["Index"])
                    seen[index] = int(decoded.signals[index])

    listen(1000)
    assert "ClockBoundUs" not in seen  # nobody has a clock of his own
    world.node.on_clock(bound_ns, 200_000)
    listen(2000)
    assert (seen["ClockBoundUs"], seen["ClockResidualUs"]) == (said, 200)
    assert len(seen) == 24
