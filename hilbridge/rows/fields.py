"""How values of a row stand in JSON: enumerations by name, bytes in hexadecimal or base64, numbers to the last bit."""

from __future__ import annotations

import base64
import math
from enum import StrEnum
from typing import Annotated

from pydantic import BeforeValidator, PlainSerializer, WithJsonSchema

from hilbridge.records import Action


def _action(value: object) -> object:
    return Action.__members__.get(value, value) if isinstance(value, str) else value


def _hex(value: object) -> object:
    return bytes.fromhex(value) if isinstance(value, str) else value


def _base64(value: object) -> object:
    return base64.b64decode(value, validate=True) if isinstance(value, str) else value


ActionByName = Annotated[Action, BeforeValidator(_action), PlainSerializer(lambda action: action.name, str)]
Hex = Annotated[bytes, BeforeValidator(_hex), PlainSerializer(lambda data: data.hex(), str)]
Base64 = Annotated[
    bytes,
    BeforeValidator(_base64),
    PlainSerializer(lambda data: base64.b64encode(data).decode("ascii"), str),
    WithJsonSchema({"type": "string", "contentEncoding": "base64"}),
]


class Direction(StrEnum):
    """Which way a frame went, seen from the bridge."""

    RX = "rx"
    TX = "tx"


class Witness(StrEnum):
    """Who says what the device does."""

    DEVICE = "device"
    """The simulated device itself."""
    BUS = "bus"
    """The bridge, by the device's CTRL_STATUS and CTRL_MEAS."""


def finite(number: float) -> float | None:
    """JSON has no NaN and no infinity: what is no number is absent."""
    return number if math.isfinite(number) else None


def number(value: float | None) -> float:
    """The way back: what is absent was no number."""
    return math.nan if value is None else value
