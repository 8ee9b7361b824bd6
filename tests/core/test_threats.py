"""What a stranger without the key can still do, with its effect: residues of the threat model in docs/safety.md (H1, H2)."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_sim import e2e, frames
from firmware_sim.memory import Received
from firmware_sim.states import Reason, State
from hilbridge.limits import MS
from hilbridge.records import HoldReason
from hilbridge.wire.codec import Codec
from hilbridge.wire.dbc import default_dbc_path
from tests.safety.rig import ACT_TAKE, Rig

requirement = pytest.mark.requirement


def forged(can_id: int, values: tuple[int, ...], counter: int) -> Received:
    return Received(can_id, e2e.protect(can_id, frames.pack(can_id, values), counter))


@requirement("P6")
def test_h1_h2_whoever_holds_for_a_dead_bridge_keeps_a_session_without_assist() -> None:
    rig = Rig().assisting(ACT_TAKE)
    rig.bridge_runs = False
    command = rig.state.receivers[frames.RECEIVED_IDS.index(frames.ACT_CMD)].counter or 0
    heartbeat = rig.state.receivers[frames.RECEIVED_IDS.index(frames.BRIDGE_HB)].counter or 0
    for k in range(60):
        hold = (frames.GATE_HOLD, 0, 0, rig.state.session, rig.state.tx_counters[1], 10)
        rig.put(forged(frames.ACT_CMD, hold, command + 1 + k))
        rig.put(forged(frames.BRIDGE_HB, (7, 1, 0, 7, frames.PROTOCOL_VERSION), heartbeat + 1 + k))
        rig.run(40)
        assert rig.outputs.assist_unm == 0 or k < 2
    assert rig.state.armed
    assert rig.state.state is State.READY  # one authorised ACT away, which nobody without the key can make


@requirement("S6")
def test_six_corrupt_commands_latch() -> None:
    rig = Rig()
    for _ in range(3):
        rig.until("READY")
        for _ in range(2):
            rig.put(Received(frames.ACT_CMD, b"\xff" * 8))
        rig.run(200)
    assert (rig.state.state, rig.state.reason) == (State.LATCHED, Reason.REPEATED_TRIPS)


@requirement("S6", "P6")
def test_a_forged_status_deceives_the_bridge_and_latches_the_device() -> None:
    rig = Rig().assisting(ACT_TAKE)
    lie = (int(State.READY), 0, 0, 0, 0, rig.state.session, 1, 1)
    rig.stranger(forged(frames.CTRL_STATUS, lie, rig.state.tx_counters[1] + 1))
    assert rig.bridge.device is not None
    assert rig.bridge.device.state == "Ready"
    rig.run(100)
    assert (rig.state.state, rig.state.reason) == (State.LATCHED, Reason.OWN_ID_SEEN)
    assert rig.outputs.assist_unm == 0
    assert rig.bridge.veto(rig.now_ms * MS) is HoldReason.DEVICE_FAULT


@requirement("P6")
def test_h1_a_file_of_the_bus_that_exchanges_act_and_hold_gives_no_assist(tmp_path: Path) -> None:
    path = tmp_path / "site.dbc"
    text = default_dbc_path().read_text()
    assert 'VAL_ 96 Gate 1 "Hold" 2 "Act"' in text
    path.write_text(text.replace('VAL_ 96 Gate 1 "Hold" 2 "Act"', 'VAL_ 96 Gate 2 "Hold" 1 "Act"'))
    rig = Rig()
    rig.wire.codec = Codec(path)
    rig.decision = ACT_TAKE
    for _ in range(4000):
        rig.tick()
        assert rig.outputs.assist_unm == 0
        assert rig.state.state is not State.ASSIST
