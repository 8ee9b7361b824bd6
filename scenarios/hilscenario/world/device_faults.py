"""Combines the lasting device faults that are under way: one that ends leaves the others. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from hilscenario.world.fault_board import Active, FaultBoard

OVERRUN = "device.tick_overrun"  # an instant, so none of the lasting ones
RESTART = "device.restart"  # so is this
WRONG_KEY = "device.wrong_key"
ENCODER, LAG, BIAS = "device.sensor_fault", "device.actuator_lag", "device.torque_bias"


@dataclass(frozen=True, slots=True)
class Broken:
    """What is wrong with the device. None is the healthy motor's own."""

    encoder_offset_mdeg: int
    lag_ms: float | None
    bias_nm: float | None


def broken(board: FaultBoard) -> Broken:
    """What is wrong now."""
    encoder, lag, bias = board.get(ENCODER), board.get(LAG), board.get(BIAS)
    return Broken(
        0 if encoder is None else round(encoder["offset_deg"] * 1000),
        None if lag is None else lag["time_constant_ms"],
        None if bias is None else bias["bias_nm"],
    )


def acting(board: FaultBoard, gives_torque: bool) -> Iterator[Active]:
    """The faults that act at this moment. A lag does nothing to a motor that gives no torque."""
    for fault in (ENCODER, LAG, BIAS):
        active = board.get(fault)
        if active is not None and (gives_torque or fault != LAG):
            yield active
