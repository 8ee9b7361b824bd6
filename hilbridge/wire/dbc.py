"""The DBC file as the codec needs it: messages, signals and what the bridge requires of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from hilbridge.wire.dbc_file import DbcError, shown_id

Value = int | float | str

HEADER_BITS = 0xFFFFFF  # CRC and counter belong to hilbridge.wire.e2e

# What the bridge cannot work without, and the signals it reads or writes.
REQUIRED: dict[str, tuple[str, ...]] = {
    "STOP": (),
    "CTRL_EMCY": ("Code", "State", "Latched", "Count"),
    "ACT_CMD": ("Gate", "Verb", "Confidence", "Session", "Echo", "SensingAge"),
    "ACT_AUTH": ("Freshness", "Mac"),
    "CTRL_STATUS": (
        "State",
        "Reason",
        "AppliedVerb",
        "Authority",
        "AcceptedCounter",
        "Session",
        "Armed",
        "AssistZero",
    ),
    "CTRL_MEAS": ("Joint", "Angle", "Velocity", "AssistTorque", "GravityTorque"),
    "BRIDGE_HB": ("SensorValid", "BridgeState", "Overruns", "BundleId", "ProtocolVersion"),
    "CTRL_HB": ("ProtocolVersion", "BootNonce"),
    "ARM_REQUEST": ("BridgeNonce", "Purpose"),
    "ARM_CHALLENGE": ("DeviceNonce", "Session"),
    "ARM_RESPONSE": ("Mac", "Session"),
    "BRIDGE_DIAG": ("Index",),
    "CTRL_DIAG": ("Index",),
}


@dataclass(frozen=True, slots=True)
class Signal:
    """One signal of the DBC as integers: raw = bits [start, start + bits), physical = raw * scale + offset."""

    name: str
    start: int
    bits: int
    is_signed: bool
    scale: int | float
    offset: int | float
    lowest: int
    highest: int
    names: Mapping[int, str] | None
    codes: Mapping[str, int] | None
    start_value: int

    def raw(self, word: int) -> int:
        """Raw value out of the frame as one little-endian integer."""
        value = (word >> self.start) & ((1 << self.bits) - 1)
        return value - (1 << self.bits) if self.is_signed and value >> (self.bits - 1) else value

    def to_raw(self, value: Value) -> int:
        """Raw value of a physical value or name. Raises ValueError where the DBC has none."""
        if isinstance(value, str):
            if self.codes is None or value not in self.codes:
                raise ValueError(f"{self.name} = {value!r}: not in the value table of the DBC")
            return self.codes[value]
        raw = round((value - self.offset) / self.scale)
        if not self.lowest <= raw <= self.highest or (self.names is not None and raw not in self.names):
            raise ValueError(f"{self.name} = {value}: outside what the DBC allows")
        return raw


class Reading(NamedTuple):
    """How decoding takes one signal out of a frame: what it needs of a `Signal`, worked out before and in its order."""

    name: str
    start: int
    mask: int
    sign: int  # the bit that makes the raw value negative, 0 where there is none
    names: Mapping[int, str] | None
    lowest: int
    highest: int
    scale: int | float
    offset: int | float


class Content(NamedTuple):
    """What a frame of a message, or of one of its multiplexer values, may hold."""

    reserved_bits: int
    readings: tuple[Reading, ...]


@dataclass(frozen=True, slots=True)
class Message:
    """One message of the DBC. `groups` has the signals of each multiplexer value, `contents` what decoding makes of it
    (under None: without multiplexer).
    """

    name: str
    can_id: int
    length: int
    senders: frozenset[str]
    cycle_ms: int
    timeout_ms: int
    data_id: int | None
    max_delta: int
    signals: tuple[Signal, ...]
    multiplexer: Signal | None
    groups: Mapping[int, tuple[Signal, ...]]
    contents: Mapping[int | None, Content]
    is_extended: bool
    is_fd: bool


def default_dbc_path() -> Path:
    """The shipped DBC: a file beside this one in an installed package, a link to dbc/ in a checkout."""
    return Path(__file__).with_name("iassistadl.dbc")


def _limits(signal: Any) -> tuple[int, int]:
    """Least and greatest raw value; a limit that is no finite number, as some tools write, limits nothing."""
    low = -(1 << (signal.length - 1)) if signal.is_signed else 0
    high = (1 << (signal.length - (1 if signal.is_signed else 0))) - 1
    ends = []
    for limit in (signal.minimum, signal.maximum):
        raw = None if limit is None else (limit - signal.offset) / signal.scale
        ends.append(round(raw) if raw is not None and math.isfinite(raw) else None)
    if signal.scale < 0:
        ends.reverse()
    return (low if ends[0] is None else max(low, ends[0])), (high if ends[1] is None else min(high, ends[1]))


def _signal(signal: Any) -> Signal:
    scale, offset = signal.scale, signal.offset
    low, high = _limits(signal)
    attributes = signal.dbc.attributes if signal.dbc else {}
    enumerated = "Enumerated" in attributes and attributes["Enumerated"].value == 1
    choices = {int(code): str(name) for code, name in (signal.choices or {}).items()}
    start = attributes["GenSigStartValue"].value if "GenSigStartValue" in attributes else 0
    return Signal(
        signal.name,
        signal.start,
        signal.length,
        bool(signal.is_signed),
        int(scale) if float(scale).is_integer() else scale,
        int(offset) if float(offset).is_integer() else offset,
        low,
        high,
        choices if enumerated else None,
        {name: code for code, name in choices.items()} if choices else None,
        int(start),
    )


def _content(signals: tuple[Signal, ...], length: int, header_bits: int) -> Content:
    used = header_bits
    readings = []
    for signal in signals:
        mask = (1 << signal.bits) - 1
        used |= mask << signal.start
        sign = 1 << (signal.bits - 1) if signal.is_signed else 0
        readings.append(
            Reading(
                signal.name,
                signal.start,
                mask,
                sign,
                signal.names,
                signal.lowest,
                signal.highest,
                signal.scale,
                signal.offset,
            )
        )
    return Content(((1 << 8 * length) - 1) & ~used, tuple(readings))


def required_message(message: Any, path: Path) -> Message:
    """The tables of a message that the bridge sends or reads. Raises DbcError: it must be one that the bus can carry."""
    shown = shown_id(message.frame_id, is_extended=message.is_extended_frame)
    if message.is_extended_frame:
        raise DbcError(
            f"{path}: message {message.name} has the extended identifier {shown}; the protocol has 11-bit ones, give it one"
        )
    if message.is_fd:
        raise DbcError(
            f"{path}: message {message.name} ({shown}) is CAN FD (VFrameFormat); the protocol is classical, take it back"
        )
    try:
        message.refresh(strict=True)
    except Exception as error:  # cantools' own kind; overlapping signals, or signals beyond the message's end
        raise DbcError(f"{path}: {' '.join(str(error).split()).rstrip('.')}; restore the message as shipped") from None
    return read_message(message, path)


def read_message(message: Any, path: Path) -> Message:
    """A message's tables. Raises DbcError for a layout that this codec does not speak."""
    attributes = {name: entry.value for name, entry in message.dbc.attributes.items()}
    if any(signal.byte_order != "little_endian" for signal in message.signals):
        raise DbcError(f"{path}: message {message.name} has big-endian signals; make them little endian (@1)")
    if any(signal.conversion.is_float for signal in message.signals):
        raise DbcError(f"{path}: message {message.name} has floating-point signals; make them integers with a scale")
    if not all(signal.scale for signal in message.signals):
        raise DbcError(f"{path}: message {message.name} has a signal of scale 0, which can say nothing; give it one")
    header = [(s.start, s.length) for s in message.signals if s.name in ("CRC", "Counter")]
    protected = "E2EDataId" in attributes
    if protected and (message.length != 8 or sorted(header) != [(0, 16), (16, 8)]):
        raise DbcError(
            f"{path}: message {message.name} cannot carry E2E profile 5: 8 bytes, CRC at bit 0, Counter at 16"
        )
    made = {s.name: _signal(s) for s in message.signals if s.name not in ("CRC", "Counter")}
    multiplexers = [s for s in message.signals if s.is_multiplexer]
    if len(multiplexers) > 1:
        raise DbcError(f"{path}: message {message.name} has nested multiplexers; use one")
    always = tuple(made[s.name] for s in message.signals if s.name in made and s.multiplexer_ids is None)
    groups: dict[int, tuple[Signal, ...]] = {}
    for signal in message.signals:
        for value in signal.multiplexer_ids or ():
            groups[value] = (*groups.get(value, ()), made[signal.name])
    header_bits = HEADER_BITS if protected else 0
    contents: dict[int | None, Content] = {}
    if not multiplexers:
        contents[None] = _content(always, message.length, header_bits)
    for value, group in groups.items():
        contents[value] = _content(always + group, message.length, header_bits)
    return Message(
        message.name,
        message.frame_id,
        message.length,
        frozenset(message.senders),
        int(message.cycle_time or 0),
        int(attributes.get("RxTimeoutMs", 0)),
        int(attributes["E2EDataId"]) if protected else None,
        int(attributes.get("E2EMaxDeltaCounter", 1)),
        always,
        made[multiplexers[0].name] if multiplexers else None,
        groups,
        contents,
        bool(message.is_extended_frame),
        bool(message.is_fd),
    )
