"""The two ends' numbers: what both know is equal, what one demands the other keeps with room to spare."""

from __future__ import annotations

import pytest

from firmware_sim import frames, secoc, transmit, watchdogs
from hilbridge import limits
from hilbridge.config import Config
from hilbridge.core.gate import GateConfig
from hilbridge.wire.codec import Codec


@pytest.mark.parametrize(
    ("bridge", "device"),
    [
        (limits.PROTOCOL_VERSION, frames.PROTOCOL_VERSION),
        (limits.SENSING_LIMIT_MS, watchdogs.SENSING_LIMIT_MS),
        (limits.AGE_UNKNOWN_MS, limits.AGE_STEP_MS * frames.AGE_UNKNOWN),
        (limits.FRESHNESS_LIMIT, secoc.FRESHNESS_LIMIT),
        (limits.STATUS_LIMIT_NS, 3 * transmit.STATUS_CYCLE_MS * limits.MS),
    ],
)
def test_what_both_ends_know_is_equal(bridge: int, device: int) -> None:
    assert bridge == device


def test_the_bridges_rhythm_keeps_every_watchdog_of_the_device_fed() -> None:
    command_ms = watchdogs.COMMAND_LIMIT_MS
    assert command_ms * limits.MS > 2 * limits.TICK_NS  # one lost frame trips nothing
    assert command_ms * limits.MS > limits.TICK_NS + limits.TICK_GRACE_NS
    assert command_ms * limits.MS > limits.OVERRUN_NS
    assert 2 * limits.HEARTBEAT_NS < watchdogs.HEARTBEAT_LIMIT_MS * limits.MS
    assert limits.STALE_COMMAND_NS < limits.TICK_NS
    assert limits.STATUS_LIMIT_NS < watchdogs.ECHO_LIMIT_MS * limits.MS


def test_the_handshake_is_tried_again_within_the_devices_patience_and_before_it_latches() -> None:
    assert limits.CHALLENGE_WAIT_NS < watchdogs.CHALLENGE_LIMIT_MS * limits.MS
    # A round of CTRL_DIAG lies within the wait, so that the bridge hears of a MAC failure before it tries again.
    assert limits.CONFIRM_WAIT_NS > transmit.DIAG_CYCLE_MS * 29 * limits.MS
    assert watchdogs.MAC_FAILURE_LIMIT > 1


def test_the_dbc_has_the_same_periods_and_timeouts() -> None:
    messages = Codec().messages
    assert messages["ACT_CMD"].cycle_ms * limits.MS == limits.TICK_NS
    assert messages["BRIDGE_HB"].cycle_ms * limits.MS == limits.HEARTBEAT_NS // limits.TICK_NS * limits.TICK_NS
    assert messages["CTRL_STATUS"].cycle_ms == transmit.STATUS_CYCLE_MS
    assert messages["CTRL_HB"].cycle_ms == transmit.HEARTBEAT_CYCLE_MS
    assert messages["ACT_CMD"].timeout_ms == watchdogs.COMMAND_LIMIT_MS
    assert messages["CTRL_STATUS"].timeout_ms * limits.MS == limits.STATUS_LIMIT_NS
    assert messages["BRIDGE_HB"].timeout_ms == watchdogs.HEARTBEAT_LIMIT_MS


def test_what_a_site_may_set_is_never_looser_than_the_contract() -> None:
    config = Config()
    assert config.gate.max_age_ms == limits.SENSING_LIMIT_MS
    assert GateConfig(0.8, 0.6).max_age_ns == limits.SENSING_LIMIT_NS
    assert GateConfig(0.8, 0.6).refractory_ns == config.gate.refractory_ms * limits.MS
    with pytest.raises(ValueError, match="max_age_ns"):
        GateConfig(0.8, 0.6, max_age_ns=limits.SENSING_LIMIT_NS + 1)
