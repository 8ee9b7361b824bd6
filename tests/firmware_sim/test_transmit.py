"""What the device sends, to the millisecond and to the last digit."""

from __future__ import annotations

from collections import defaultdict

import pytest

from firmware_sim import frames, transmit
from firmware_sim.memory import COUNTERS, ControllerState, Inputs
from firmware_sim.torque import Torque
from tests.safety.hand import BOOT_NONCE, KEY, Hand
from tests.safety.stepping import step

requirement = pytest.mark.requirement


@requirement("P11")
def test_every_cycle_to_the_millisecond_and_every_counter_in_turn() -> None:
    state, at, indices = ControllerState(KEY, BOOT_NONCE), defaultdict(list), []
    for now_ms in range(1, 2101):
        state, outputs = step(state, Inputs(), now_ms)
        for can_id, data in outputs.frames:
            at[can_id].append(now_ms)
            if can_id == frames.CTRL_DIAG:
                indices.append(data[3])
    assert at[frames.CTRL_MEAS] == list(range(10, 2101, 20))
    assert at[frames.CTRL_HB] == list(range(5, 2101, 100))
    assert at[frames.CTRL_DIAG] == list(range(15, 2101, 34))
    assert indices == [k % COUNTERS for k in range(len(indices))]


@pytest.mark.parametrize(
    ("angle", "velocity", "assist", "gravity", "expected"),
    [
        (0, 0, 0, 0, (0, 120, 0, 0, 0)),
        (-30_001, 0, 0, 0, (0, 0, 0, 0, 0)),
        (225_750, 1_022_000, 2_540_000, 6_350_000, (0, 1023, 511, 127, 127)),
        (226_000, 1_024_000, 2_560_000, 6_400_000, (0, 1023, 511, 127, 127)),
        (30_000, 1_000_000, 2_520_000, 6_300_000, (0, 240, 500, 126, 126)),
        (29_999, 999_999, 2_519_999, 6_299_999, (0, 239, 499, 125, 125)),
        (30_000, -1_000_000, -2_520_000, -6_300_000, (0, 240, -500, -126, -126)),
        (30_000, -2_000_000, -2_560_000, -6_400_000, (0, 240, -511, -127, -127)),
    ],
)
def test_measurements_have_the_scales_and_bounds_of_the_dbc(
    angle: int, velocity: int, assist: int, gravity: int, expected: tuple[int, ...]
) -> None:
    state = ControllerState(KEY, BOOT_NONCE)
    state.torque = Torque(assist_unm=assist, gravity_unm=gravity)
    assert transmit._measurement(state, Inputs(angle_mdeg=angle, velocity_mdeg_s=velocity)) == expected


def test_authority_on_the_wire_is_never_below_zero() -> None:
    hand = Hand().to_assist()
    hand.state.torque.authority = 0
    hand.tick(user_torque_unm=-2_000_000 if hand.outputs.assist_unm > 0 else 2_000_000)
    transmit.send_status(hand.state, hand.now_ms)
    _, values = frames.unpack(frames.CTRL_STATUS, hand.state.outbox[-1][1])
    assert values[3] == 0
