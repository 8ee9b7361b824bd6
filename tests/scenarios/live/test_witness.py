"""A device known by its frames alone: what the witness makes of them against what the device's own log says."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from firmware_sim.attachment import Arrival, Spec
from firmware_sim.frames import STOP
from firmware_sim.memory import Received
from hilbridge.bus.port.spec import BusSpec, parse_spec
from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.records import Frame
from hilbridge.wire.codec import Codec
from hilscenario.format.schema import Scenario
from hilscenario.live.external import External, HeardRows, external_device, refuse_silence, reset
from hilscenario.live.possible import impossible_live
from hilscenario.live.witness import Witness
from tests.safety.rig import ACT_POUR, HOLD, Rig
from tests.scenarios.made import scenario

BUS = BusSpec("hilsim", "under-test")


class Watched:
    """A rig whose frames, both ways, a witness hears, too."""

    def __init__(self) -> None:
        self.rig = Rig()
        self.witness = Witness(Codec())
        self.lines: list[dict[str, object]] = []
        self.rig.to_device = self._hear
        self.rig.to_bridge = self._hear

    def _hear(self, frame: Received) -> list[Received]:
        self.lines += self.witness.take(Frame(frame.can_id, frame.data, self.rig.now_ms * MS))
        return [frame]

    @property
    def last(self) -> dict[str, object]:
        return self.lines[-1]


def test_it_knows_state_session_and_torque() -> None:
    watched = Watched()
    rig = watched.rig.assisting(ACT_POUR, settle_ms=600)
    line = watched.last
    assert (line["state"], line["armed"], line["session"]) == ("Assist", True, rig.state.session)
    assert line["accepted_hold"] is False
    assert line["accepted_live"] is True
    assert line["accepted_ms"] == pytest.approx(rig.state.command_ms, abs=41)
    assert line["assist_nm"] == pytest.approx(rig.outputs.assist_unm * 1e-6, abs=0.05)
    assert line["gravity_nm"] == pytest.approx(rig.outputs.gravity_unm * 1e-6, abs=0.06)


def test_zero_is_exactly_zero_and_a_hold_is_one() -> None:
    watched = Watched()
    watched.rig.assisting(ACT_POUR)
    watched.rig.decision = HOLD
    watched.rig.run(200)
    assert (watched.last["state"], watched.last["assist_nm"], watched.last["accepted_hold"]) == ("Ready", 0.0, True)


def test_it_remembers_the_first_stop() -> None:
    watched = Watched()
    watched.rig.assisting(ACT_POUR)
    watched.rig.put(Received(STOP, b""))
    stopped_ms = watched.rig.now_ms
    watched.rig.run(100)
    watched.rig.put(Received(STOP, b""))
    watched.rig.run(100)
    assert watched.last["state"] == "EStop"
    assert watched.last["stop_ms"] == stopped_ms


def test_lines_come_in_order_and_a_rise_is_never_steeper_than_it_was() -> None:
    watched = Watched()
    watched.rig.assisting(ACT_POUR, settle_ms=1500)
    stamps = [line["ends_ns"] for line in watched.lines]
    assert stamps == sorted(stamps)
    pairs = zip(watched.lines, watched.lines[1:], strict=False)
    for before, after in pairs:
        took_s = (after["ends_ns"] - before["ends_ns"]) / 1e9  # type: ignore[operator]
        rise = abs(float(str(after["assist_nm"]))) - abs(float(str(before["assist_nm"])))
        assert rise <= 12.0 * took_s + 0.0021


def test_rubbish_is_no_line() -> None:
    witness = Witness(Codec())
    assert [witness.take(Frame(can_id, bytes(8))) for can_id in (0x0A0, 0x0A1, 0x060, 0x7FF)] == [[], [], [], []]


def test_what_is_asked_for_is_refused_where_it_makes_no_sense() -> None:
    assert external_device("simulated", None, live=False) is None
    assert external_device("external", "can1", live=True) == External("can1")
    for device, plant_bus, live in (("real", None, True), ("simulated", "can1", True), ("external", None, False)):
        with pytest.raises(InputError):
            external_device(device, plant_bus, live=live)


def test_a_bus_without_a_device_or_with_a_bridge_is_refused() -> None:
    ready, stopped = bytes((0, 0, 0, 3, 0, 0, 0, 0)), bytes((0, 0, 0, 8, 0, 0, 0, 0))
    refuse_silence(BUS, {0x0A0: ready, 0x0A1: b""})
    with pytest.raises(InputError, match="no device under test is heard"):
        refuse_silence(BUS, {0x121: b""})
    with pytest.raises(InputError, match="a bridge is on it already"):
        refuse_silence(BUS, {0x0A0: ready, 0x060: b""})
    with pytest.raises(InputError, match="latched or stopped; clear it, or give --reset-command"):
        refuse_silence(BUS, {0x0A0: stopped})


def test_a_reset_command_that_fails_is_one_line() -> None:
    reset("true")
    for command in ("false", "no-such-command-here", '"', ""):
        with pytest.raises(InputError, match="give one that resets the device"):
            reset(command)


def _scenario(fault: str, **device: str) -> Scenario:
    step = {"at": "100 ms", "fault": fault} | ({} if fault == "device.restart" else {"for": "100 ms"})
    return scenario(steps=[step], device=device)


@pytest.mark.parametrize("fault", ["device.sensor_fault", "device.torque_bias", "wearer.opposing"])
def test_faults_within_an_external_device_are_refused_with_their_line(fault: str) -> None:
    asked = _scenario(fault)
    assert impossible_live(asked, BUS) is None
    found = impossible_live(asked, BUS, external=True)
    assert found is not None
    assert found.location == ("steps", 0, "fault")


def test_an_external_device_is_reset_by_its_users_command_alone() -> None:
    found = impossible_live(_scenario("device.restart"), BUS, external=True)
    assert found is not None
    assert "reset_command" in found.why
    assert impossible_live(_scenario("device.restart", reset_command="true"), BUS, external=True) is None


CAN0 = parse_spec("can0")
READY = bytes((0, 0, 0, 3, 0, 0, 0, 0))


def test_h1_an_unknown_node_on_a_physical_bus_ends_it() -> None:
    refuse_silence(CAN0, {0x0A0: READY, 0x0A1: b"", 0x121: b""})
    for stranger in (0x7E8, 0x18FF0060, 0x001):
        with pytest.raises(InputError, match=f"an unknown node sends {stranger:#05x}"):
            refuse_silence(CAN0, {0x0A0: READY, stranger: b""})
        refuse_silence(BUS, {0x0A0: READY, stranger: b""})


@dataclass
class FakeBus:
    """A bus that brings one frame of each identifier; a wire is hardware nobody has here."""

    spec: Spec
    can_ids: tuple[int, ...]

    def read(self, now_ns: int) -> list[Arrival]:
        return [Arrival(now_ns, Received(can_id, b"")) for can_id in self.can_ids]

    def close(self) -> None:
        pass


@pytest.mark.parametrize(("can_id", "known"), [(0x060, True), (0x001, True), (0x301, True), (0x123, False)])
def test_h1_an_unknown_node_that_comes_to_a_physical_bus_ends_the_run(can_id: int, known: bool) -> None:
    rows = HeardRows(FakeBus(Spec("socketcan", "can0", True), (0x0A0, can_id)), Witness(Codec()))  # type: ignore[arg-type]
    if known:
        assert rows.new() == []
    else:
        with pytest.raises(InputError, match="an unknown node sends 0x123; the run has ended"):
            rows.new()
    virtual = FakeBus(Spec("hilsim", "x", False), (can_id,))
    assert HeardRows(virtual, Witness(Codec())).new() == []  # type: ignore[arg-type]
