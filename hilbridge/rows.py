"""The rows of a recording: one frozen record a topic, and the one encoder. Live runs and virtual time write the same.

A row is a JSON object; its time is the message's own log time. Units stand at the end of names; every `_ns` is the
monotonic clock, in virtual time the scenario's. A value that was not known is None here, and absent in the JSON.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import BeforeValidator, PlainSerializer, TypeAdapter, ValidationError
from pydantic_core import from_json

from hilbridge.records import Action, Frame, HoldReason


def _action(value: object) -> object:
    return Action.__members__.get(value, value) if isinstance(value, str) else value


def _bytes(value: object) -> object:
    return bytes.fromhex(value) if isinstance(value, str) else value


ActionByName = Annotated[Action, BeforeValidator(_action), PlainSerializer(lambda action: action.name, str)]
Hex = Annotated[bytes, BeforeValidator(_bytes), PlainSerializer(lambda data: data.hex(), str)]


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


@dataclass(frozen=True, slots=True)
class TickRow:
    """One 25 Hz tick: what was decided, on what, and why."""

    topic: ClassVar[str] = "/tick"

    time_ns: int
    action: ActionByName
    """The command as sent."""
    reason: HoldReason
    """Why the bridge holds; `none` under ACT."""
    confidence: float
    """Smoothed confidence that the gate compares with its thresholds, 0..1."""
    verb: str | None = None
    """The assisted verb under ACT."""
    top: tuple[tuple[str, float], ...] = ()
    """The likeliest verbs with their calibrated probabilities, likeliest first."""
    top_confidence: float | None = None
    """Calibrated confidence in the likeliest verb, before smoothing."""
    valid: tuple[bool, bool, bool] = (False, False, False)
    """Which modalities the newest features have: gaze, hands, scene."""
    sensing_age_ms: float | None = None
    """Age of the oldest input in the newest features."""
    sensor_problem: str | None = None
    """The first sensor that cannot be believed, and why."""
    new_features: bool = False
    """Whether this tick had features that no earlier tick had."""
    device_state: str | None = None
    """The device's state as last heard, in the DBC's words."""
    armed: bool = False
    """Whether a session with the device stands."""
    work_ms: float | None = None
    """From the start of the tick to its last frame handed to the port."""
    latency_ms: float | None = None
    """From the capture of the picture to its ACT_CMD handed to the port."""
    truth_known: bool = False
    """Whether the wearer's intention is known: simulated and labelled people."""
    truth: str | None = None
    """The verb that the wearer prepares or does; None while idle."""
    right: bool | None = None
    """Under ACT with known truth: whether the assisted verb is the wearer's."""


class GroundTruth(NamedTuple):
    """What the wearer really wants at one moment: the verb prepared or under way, and whether an assist of ours is it."""

    verb: str | None
    right: bool | None


@dataclass(frozen=True, slots=True)
class CanRow:
    """One CAN frame that the bridge sent or received."""

    topic: ClassVar[str] = "/can"

    time_ns: int
    direction: Direction
    can_id: int
    data: Hex
    """Payload, in hexadecimal."""
    name: str | None = None
    """The message's name where it was accepted; None for what was rejected, and for frames sent."""
    result: str | None = None
    """What the port did with a frame to send."""
    received_ns: int = 0
    """When the frame arrived; 0 for frames sent."""
    wall_ns: int = 0
    """The wall clock at arrival where the driver gives it; 0 otherwise."""
    is_error: bool = False
    is_extended: bool = False
    is_fd: bool = False
    is_remote: bool = False
    channel: str | None = None
    """Of a log that was imported, like the three below: which bus it was."""
    switches_rate: bool | None = None
    """An FD frame's bit rate switch."""
    sender_passive: bool | None = None
    """An FD frame's error state indicator."""
    asked_length: int | None = None
    """How many bytes a remote frame asks for."""


@dataclass(frozen=True, slots=True)
class DeviceRow:
    """What the device is doing; states, reasons and verbs in the DBC's words.

    The device's own word has every field. By the bus, the fields of CTRL_STATUS and of CTRL_MEAS hold until the next.
    """

    topic: ClassVar[str] = "/device"

    time_ns: int
    witness: Witness
    state: str
    reason: str
    armed: bool
    verb: str
    """The verb being assisted, or `None`."""
    assist_zero: bool
    """Whether assist is exactly zero."""
    assist_nm: float | None = None
    gravity_nm: float | None = None
    """Support of the wearer's own arm."""
    follow_nm: float | None = None
    """Compensation of the device's own weight and friction."""
    angle_deg: float | None = None
    velocity_deg_s: float | None = None
    authority: float | None = None
    """Share of the assist that the wearer's opposition leaves, in percent."""
    session: int | None = None
    trips: int | None = None
    """Remembered trips of the last minute."""
    device_ms: int | None = None
    """The device's own clock."""
    accepted_ms: int | None = None
    """When the newest accepted command came, on the device's own clock."""
    accepted_counter: int | None = None
    accepted_hold: bool | None = None
    """Whether the newest accepted command counts as HOLD."""


@dataclass(frozen=True, slots=True)
class SourceAccount:
    """What became of every value of one source."""

    received: int
    used: int
    overwritten: int
    """Replaced by a newer one before anybody looked."""
    failed: int
    pending: int
    with_hands: int | None = None
    """Pictures in which a hand was found."""


@dataclass(frozen=True, slots=True)
class SensorsRow:
    """Once a second: the account of every source."""

    topic: ClassVar[str] = "/sensors"

    time_ns: int
    sources: dict[str, SourceAccount]


@dataclass(frozen=True, slots=True)
class CountersRow:
    """Once a second, and at the end: every counter by name. `device.`, `wire.`, `port.`, `bridge.` name their owner."""

    topic: ClassVar[str] = "/counters"

    time_ns: int
    counts: dict[str, int]


@dataclass(frozen=True, slots=True)
class EventRow:
    """What a person would want to know: armed, link down, sensor gone, a fault injected."""

    topic: ClassVar[str] = "/event"

    time_ns: int
    text: str


@dataclass(frozen=True, slots=True)
class MetaRow:
    """Once, first: who recorded what, with which configuration."""

    topic: ClassVar[str] = "/meta"

    time_ns: int
    title: str | None = None
    bus: str | None = None
    physical: bool | None = None
    listen_only: bool | None = None
    bundle_id: str | None = None
    tau_on: float | None = None
    tau_off: float | None = None
    camera: str | None = None
    gaze: str | None = None
    scenario: str | None = None
    seed: int | None = None
    start_ns: int | None = None
    """A live scenario's time 0 on the monotonic clock; its rows are relative to it."""
    wall_minus_monotonic_ns: int | None = None


def with_truth(row: TickRow, truth: GroundTruth | None) -> TickRow:
    """The tick judged; None where the wearer's intention is not known."""
    return row if truth is None else replace(row, truth_known=True, truth=truth.verb, right=truth.right)


def received_row(frame: Frame, name: str | None, now_ns: int) -> CanRow:
    """A frame that the bridge took in; `name` is the message's where it was accepted."""
    return CanRow(
        now_ns,
        Direction.RX,
        frame.can_id,
        frame.data,
        name,
        None,
        frame.received_ns,
        frame.wall_ns,
        frame.is_error,
        frame.is_extended,
        frame.is_fd,
        frame.is_remote,
    )


def sent_row(frame: Frame, result: str | None, now_ns: int) -> CanRow:
    """A frame that the bridge handed to its port, and what the port did with it."""
    return CanRow(now_ns, Direction.TX, frame.can_id, frame.data, None, result)


Row = TickRow | CanRow | DeviceRow | SensorsRow | CountersRow | EventRow | MetaRow
TOPICS: dict[str, type[Row]] = {
    row.topic: row for row in (MetaRow, TickRow, CanRow, DeviceRow, SensorsRow, CountersRow, EventRow)
}
_ADAPTERS: dict[str, TypeAdapter[Any]] = {topic: TypeAdapter(row) for topic, row in TOPICS.items()}


def encode(row: Row) -> bytes:
    """The row as JSON, without its time. Equal rows are equal bytes."""
    return _ADAPTERS[row.topic].dump_json(row, exclude={"time_ns"}, exclude_none=True)


def decode(topic: str, time_ns: int, data: bytes) -> Row:
    """The row that `encode` made. Raises ValueError that names topic and field for anything else."""
    fields = from_json(data)
    if not isinstance(fields, dict):
        raise ValueError(f"{topic}: not a JSON object")
    return from_fields(topic, time_ns, fields)


def from_fields(topic: str, time_ns: int, fields: Mapping[str, Any]) -> Row:
    """The row with these JSON values. Raises ValueError that names topic and field."""
    adapter = _ADAPTERS.get(topic)
    if adapter is None:
        raise ValueError(f"{topic}: no such topic")
    try:
        row: Row = adapter.validate_python({**fields, "time_ns": time_ns})
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"{topic}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    return row


def json_schema(topic: str) -> dict[str, Any]:
    """The JSON schema of a topic's rows, with plain types: viewers list only fields that `properties` names so."""
    schema = _ADAPTERS[topic].json_schema(mode="serialization")
    del schema["properties"]["time_ns"]
    schema["required"] = [name for name in schema["required"] if name != "time_ns"]
    schema["properties"] = {name: _plain(part) for name, part in schema["properties"].items()}
    return schema


def _plain(part: dict[str, Any]) -> dict[str, Any]:
    """`anyOf` a type and null becomes the type: what is not known is absent, never null."""
    kinds = [kind for kind in part.get("anyOf", ()) if kind != {"type": "null"}]
    if len(kinds) != 1:
        return part
    return {**{key: value for key, value in part.items() if key not in ("anyOf", "default")}, **kinds[0]}
