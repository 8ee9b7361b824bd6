"""Only CTRL_STATUS feeds the deadline of CTRL_STATUS, and no repr shows a key (H9)."""

from __future__ import annotations

from firmware_sim.memory import ControllerState
from hilbridge.records import HoldReason
from tests.safety.rig import HOLD, Rig


def test_h9_no_other_message_of_the_device_feeds_the_status_deadline() -> None:
    rig = Rig().until("READY")
    status = 0x0A0
    rig.to_bridge = lambda frame: [] if frame.can_id == status else [frame]
    rig.run(120)
    assert rig.bridge.veto(rig.now_ms * 1_000_000) is HoldReason.DEVICE_SILENT
    assert HOLD.reason is not HoldReason.DEVICE_SILENT


def test_no_repr_shows_a_key() -> None:
    state = ControllerState(b"sixteen secret b", 1)
    state.key = b"another secret 1"
    assert "secret" not in repr(state)
