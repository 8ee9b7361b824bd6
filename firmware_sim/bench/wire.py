"""The frames of dbc/plant.dbc by hand, as a board would write them; a test holds the two together. Pure."""

from __future__ import annotations

from typing import NamedTuple

ANGLE_IDS = (0x100, 0x102)
MOTION_IDS = (0x101, 0x103)
TORQUE_ID = 0x110
JOINTS = 2
_MOST = (1 << 23) - 1
_MOST_SMALL = (1 << 15) - 1


class Reading(NamedTuple):
    """One joint of one step: what encoders, velocity and torque sensor say, and what the motor gives."""

    angle_mdeg: int = 0
    second_angle_mdeg: int = 0
    velocity_mdeg_s: int = 0
    user_torque_unm: int = 0
    measured_unm: int = 0
    hand: bool = False


class Torque(NamedTuple):
    """The device's answer to the step of counter `echo`, uN m a joint."""

    counter: int
    echo: int
    torque_unm: tuple[int, int]


def _signed(value: int, most: int) -> int:
    """Two's complement, held at the field's ends."""
    return max(-most - 1, min(most, value)) & (2 * most + 1)


def _value(raw: int, bits: int) -> int:
    raw &= (1 << bits) - 1
    return raw - (1 << bits) if raw >> (bits - 1) else raw


def step_frames(counter: int, readings: tuple[Reading, ...]) -> list[tuple[int, bytes]]:
    """All frames of one step, the motion of a joint after its angles."""
    frames = []
    for joint, one in enumerate(readings):
        angles = counter | _signed(one.angle_mdeg, _MOST) << 8 | _signed(one.second_angle_mdeg, _MOST) << 32
        angles |= 1 << 56 | one.hand << 57
        motion = counter | _signed(one.velocity_mdeg_s, _MOST) << 8
        motion |= _signed(round(one.user_torque_unm / 1000), _MOST_SMALL) << 32
        motion |= _signed(round(one.measured_unm / 1000), _MOST_SMALL) << 48
        frames.append((ANGLE_IDS[joint], angles.to_bytes(8, "little")))
        frames.append((MOTION_IDS[joint], motion.to_bytes(8, "little")))
    return frames


def read_step(angle: bytes, motion: bytes) -> tuple[int, Reading] | None:
    """Counter and reading of one joint; None for what is no pair of frames of one step, or a joint that is not there."""
    if len(angle) != 8 or len(motion) != 8 or angle[0] != motion[0] or not angle[7] & 1 or angle[7] >> 2:
        return None
    angles, moved = int.from_bytes(angle, "little"), int.from_bytes(motion, "little")
    return angle[0], Reading(
        _value(angles >> 8, 24),
        _value(angles >> 32, 24),
        _value(moved >> 8, 24),
        1000 * _value(moved >> 32, 16),
        1000 * _value(moved >> 48, 16),
        bool(angle[7] & 2),
    )


def torque_frame(torque: Torque) -> bytes:
    """DEVICE_TORQUE."""
    first, second = torque.torque_unm
    word = torque.counter | torque.echo << 8 | _signed(first, _MOST) << 16 | _signed(second, _MOST) << 40
    return word.to_bytes(8, "little")


def read_torque(data: bytes) -> Torque | None:
    """What a DEVICE_TORQUE says; None for another length."""
    if len(data) != 8:
        return None
    word = int.from_bytes(data, "little")
    return Torque(data[0], data[1], (_value(word >> 16, 24), _value(word >> 40, 24)))
