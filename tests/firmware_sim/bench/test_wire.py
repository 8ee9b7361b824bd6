"""The hand-written frames of the plant bus against dbc/plant.dbc."""

from __future__ import annotations

from pathlib import Path

import cantools
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.bench.wire import (
    ANGLE_IDS,
    TORQUE_ID,
    Reading,
    Torque,
    read_step,
    read_torque,
    step_frames,
    torque_frame,
)

DBC = cantools.database.load_file(Path(__file__).parents[3] / "dbc" / "plant.dbc")
BYTE = st.integers(0, 255)
WIDE = st.integers(-(1 << 23), (1 << 23) - 1)
TORQUES = st.integers(-32_768, 32_767).map(lambda milli: 1000 * milli)
READINGS = st.builds(Reading, WIDE, WIDE, WIDE, TORQUES, TORQUES, st.booleans())


@given(BYTE, READINGS, READINGS)
def test_a_step_is_as_the_dbc_says_and_comes_back(counter: int, first: Reading, second: Reading) -> None:
    frames = dict(step_frames(counter, (first, second)))
    for joint, reading in enumerate((first, second)):
        angle, motion = frames[ANGLE_IDS[joint]], frames[ANGLE_IDS[joint] + 1]
        assert read_step(angle, motion) == (counter, reading)
        assert DBC.decode_message(ANGLE_IDS[joint], angle) == {
            "Counter": counter,
            "Angle": reading.angle_mdeg,
            "SecondAngle": reading.second_angle_mdeg,
            "Present": 1,
            "Hand": int(reading.hand),
        }
        assert DBC.decode_message(ANGLE_IDS[joint] + 1, motion) == {
            "Counter": counter,
            "Velocity": reading.velocity_mdeg_s,
            "WearerTorque": reading.user_torque_unm // 1000,
            "MotorTorque": reading.measured_unm // 1000,
        }


@given(BYTE, BYTE, WIDE, WIDE)
def test_torque_is_as_the_dbc_says_and_comes_back(counter: int, echo: int, first: int, second: int) -> None:
    torque = Torque(counter, echo, (first, second))
    data = torque_frame(torque)
    assert read_torque(data) == torque
    told = DBC.decode_message(TORQUE_ID, data)
    assert told == {"Counter": counter, "Echo": echo, "Torque1": first, "Torque2": second}


@given(st.binary(max_size=9), st.binary(max_size=9))
def test_reading_never_raises(first: bytes, second: bytes) -> None:
    read_step(first, second)
    read_torque(first)


def test_what_does_not_fit_is_held_at_its_end() -> None:
    ((_, angle), (_, motion)) = step_frames(0, (Reading(10**9, -(10**9), 0, 10**12, -(10**12)),))
    step = read_step(angle, motion)
    assert step is not None
    assert step[1] == Reading(8_388_607, -8_388_608, 0, 32_767_000, -32_768_000)


def test_frames_of_two_steps_are_no_pair() -> None:
    (_, angle), _ = step_frames(1, (Reading(),))
    _, (_, motion) = step_frames(2, (Reading(),))
    assert read_step(angle, motion) is None
