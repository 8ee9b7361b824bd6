"""What the device sends by itself: cycles, protection, status, emergencies."""

from __future__ import annotations

import pytest

from firmware_sim import frames, transmit
from firmware_sim.memory import ControllerState, Inputs, Received
from firmware_sim.secoc import DEMO_KEY
from firmware_sim.states import Reason, State
from firmware_sim.torque import Torque

requirement = pytest.mark.requirement


def cyclic(milliseconds: int) -> dict[int, list[tuple[int, bytes]]]:
    state, sent = ControllerState(DEMO_KEY, 0xABCD), {}
    from tests.safety.stepping import step

    for now_ms in range(1, milliseconds + 1):
        state, outputs = step(state, Inputs(), now_ms)
        for can_id, data in outputs.frames:
            sent.setdefault(can_id, []).append((now_ms, data))
    return sent


@requirement("P11")
def test_cycles_are_those_of_the_contract() -> None:
    sent = cyclic(5000)
    assert [ms for ms, _ in sent[frames.CTRL_STATUS][:6]] == [1, 21, 41, 51, 71, 91]  # 51: a change of state, at once
    assert len(sent[frames.CTRL_MEAS]) == 250
    assert len(sent[frames.CTRL_HB]) == 50
    indices = [data[3] for ms, data in sent[frames.CTRL_DIAG] if ms <= 1000]
    assert sorted(set(indices)) == list(range(29))  # each counter within the second


@requirement("P1")
def test_every_frame_sent_is_protected_and_counts_up() -> None:
    from firmware_sim.e2e import frame_crc

    for can_id, log in cyclic(2000).items():
        for _, data in log:
            assert frame_crc(can_id, data) == data[0] | data[1] << 8
        counters = [data[2] for _, data in log]
        assert counters == [(k + 1) & 0xFF for k in range(len(counters))]


def test_measurements_are_in_range_whatever_the_sensors_say() -> None:
    state = ControllerState(DEMO_KEY, 1)
    state.torque = Torque(assist_unm=-9_000_000, gravity_unm=9_000_000)
    for angle, velocity in ((-99_000_000, -99_000_000), (99_000_000, 99_000_000), (60_000, 30_000)):
        values = transmit._measurement(state, Inputs(angle_mdeg=angle, velocity_mdeg_s=velocity))
        frames.pack(frames.CTRL_MEAS, values)
    assert values == (0, 360, 15, -128 + 1, 127)


@requirement("P11")
def test_status_says_what_is() -> None:
    state = ControllerState(DEMO_KEY, 1)
    state.state, state.reason, state.verb = State.ASSIST, Reason.AUTHORISED, 10
    state.torque = Torque(assist_unm=5, authority=735)
    state.armed, state.session, state.accepted_counter = True, 9, 77
    transmit.send_status(state, 1000)
    can_id, data = state.outbox[-1]
    assert frames.unpack(can_id, data)[1] == (4, 27, 10, 73, 77, 9, 1, 0)
    state.state, state.torque = State.RAMP_DOWN, Torque()
    transmit.send_status(state, 1020)
    assert frames.unpack(*state.outbox[-1])[1] == (5, 27, 0, 0, 77, 9, 1, 1)
    assert state.echoes == ((1, 1000), (2, 1020))
    for k in range(30):
        transmit.send_status(state, 2000 + k)
    assert len(state.echoes) == 16


@requirement("P11")
def test_trips_and_latches_send_an_emergency() -> None:
    from tests.safety.hand import Hand

    hand = Hand().to_assist()
    hand.log.clear()
    hand.run(110)
    emergencies = [frames.unpack(i, d)[1] for i, d in hand.log if i == frames.CTRL_EMCY]
    assert emergencies == [(int(Reason.COMMAND_TIMEOUT), int(State.RAMP_DOWN), 0, 1)]
    hand.log.clear()
    hand.tick(Received(frames.STOP, b""))
    emergencies = [frames.unpack(i, d)[1] for i, d in hand.log if i == frames.CTRL_EMCY]
    assert emergencies == [(int(Reason.STOP_RECEIVED), int(State.ESTOP), 1, 2)]
