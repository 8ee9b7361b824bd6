"""Bridge and controller together, frame by frame, in virtual time."""

from __future__ import annotations

import pytest

from firmware_sim import frames as device_frames
from firmware_sim.memory import Received
from firmware_sim.states import Reason, State
from hilbridge.limits import MS
from hilbridge.records import HoldReason
from tests.safety.rig import ACT_POUR, ACT_TAKE, HOLD, Rig

requirement = pytest.mark.requirement


# Both ends on a perfect bus


@requirement("S2", "S3")
def test_the_two_ends_arm_hold_and_assist() -> None:
    rig = Rig().assisting()
    assert rig.state.armed
    assert rig.bridge.session.number == rig.state.session
    assert rig.bridge.veto(rig.now_ms * MS) is HoldReason.NONE
    assert rig.wire.counters["LostFrames"] == 0


@requirement("T1", "P13")
def test_h2_a_dead_bridge_leaves_no_assist() -> None:
    rig = Rig().assisting()
    rig.bridge_runs = False
    accepted_ms = rig.state.command_ms
    rig.milliseconds_until_zero()
    assert rig.now_ms - accepted_ms <= 150
    rig.run(5)
    assert rig.state.state == State.FOLLOW
    rig.bridge_runs, rig.decision = True, ACT_TAKE
    rig.run(2000)
    assert rig.state.state == State.ASSIST  # recovers alone, through neutral


@requirement("T2", "S4")
def test_h7_a_change_of_verb_with_both_ends() -> None:
    rig = Rig().assisting(ACT_TAKE)
    rig.decision = ACT_POUR
    rig.run(400)
    assert rig.state.state == State.ASSIST
    assert rig.state.verb == 10
    states = [name for _, name, _ in rig.history]
    first = states.index("ASSIST")
    assert "FOLLOW" not in states[first:]
    assert "RAMP_DOWN" in states[first:]


@requirement("P6")
def test_h1_a_bridge_with_another_key_gets_nothing_and_does_not_latch_the_device() -> None:
    rig = Rig(key=b"another key here")
    rig.decision = ACT_TAKE
    rig.run(6000)
    assert rig.state.state == State.FOLLOW
    assert rig.state.mac_failures == 1
    assert rig.bridge.session.refused
    assert all(assist == 0 for _, _, assist in rig.history)


@requirement("S7")
def test_the_whole_way_out_of_a_latch_with_both_ends() -> None:
    rig = Rig().assisting()
    rig.put(Received(device_frames.CTRL_HB, b""))
    rig.tick()
    assert rig.state.reason == Reason.OWN_ID_SEEN
    rig.run(1000)
    assert rig.state.state == State.LATCHED
    assert rig.bridge.veto(rig.now_ms * MS) is HoldReason.DEVICE_FAULT
    rig.bridge.request_clear_latch()
    rig.run(300)
    assert rig.state.clear_until_ms > rig.now_ms
    rig.tick(local_clear=True)
    rig.decision = HOLD
    rig.until("READY")


@requirement("P14")
def test_every_second_command_lost_still_assists() -> None:
    rig = Rig().assisting()
    lost = {"n": 0}

    def lossy(frame: Received) -> list[Received]:
        if frame.can_id in (device_frames.ACT_CMD, device_frames.ACT_AUTH):
            lost["n"] += frame.can_id == device_frames.ACT_CMD
            return [frame] if lost["n"] % 2 else []
        return [frame]

    rig.to_device = lossy
    rig.run(3000)
    assert rig.state.state == State.ASSIST
    assert {name for _, name, _ in rig.history[-2900:]} == {"ASSIST"}
