"""What is read out of the frames after a reason for assist has gone."""

from __future__ import annotations

from hilbridge.conformance.cases.timing import even, fall_of
from hilbridge.conformance.findings import Heard
from hilbridge.limits import MS


def status(at_ms: float, zero: int) -> Heard:
    return Heard(round(at_ms * MS), "CTRL_STATUS", {"AssistZero": zero}, 0)


def meas(at_ms: float, torque: float) -> Heard:
    return Heard(round(at_ms * MS), "CTRL_MEAS", {"AssistTorque": torque}, 0)


def test_torque_that_comes_back_is_seen_though_zero_was_told() -> None:
    fall = fall_of([status(110, 1), meas(130, 0.2), status(131, 1)], 100 * MS)
    assert (fall.last_seen_ms, fall.zero_told_ms) == (30.0, 31.0)


def test_without_a_zero_there_is_none() -> None:
    assert fall_of([status(110, 0)], 100 * MS).zero_told_ms is None


def test_uneven_measurements_say_that_a_computer_was_late() -> None:
    assert even([meas(0, 0), meas(20, 0), meas(41, 0)], 2.0)
    assert not even([meas(0, 0), meas(20, 0), meas(55, 0)], 2.0)
    assert not even([meas(0, 0), meas(20, 0)], 2.0)
