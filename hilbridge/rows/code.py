"""The one encoder of rows: JSON without the row's time. Equal rows are equal bytes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from pydantic import TypeAdapter, ValidationError
from pydantic_core import from_json, to_json

from hilbridge.rows.bus import SIGNAL_TOPICS, CanRow, DeviceRow, SignalRow
from hilbridge.rows.decisions import BeliefRow, TickRow
from hilbridge.rows.fields import Direction
from hilbridge.rows.run import BundleRow, ConfigRow, CountersRow, EventRow, FaultRow, HostRow, LabelRow, MetaRow
from hilbridge.rows.schema import viewable
from hilbridge.rows.senses import (
    ClockRow,
    FeaturesRow,
    GazeRow,
    HandsRow,
    ImageRow,
    InertialRow,
    SceneRow,
    SensorsRow,
    SkeletonRow,
)

FixedRow = (
    MetaRow
    | HostRow
    | ConfigRow
    | BundleRow
    | TickRow
    | BeliefRow
    | FeaturesRow
    | ImageRow
    | SceneRow
    | GazeRow
    | HandsRow
    | InertialRow
    | SkeletonRow
    | CanRow
    | DeviceRow
    | FaultRow
    | SensorsRow
    | ClockRow
    | CountersRow
    | EventRow
    | LabelRow
)
Row = FixedRow | SignalRow
TOPICS: dict[str, type[FixedRow]] = {row.topic: row for row in FixedRow.__args__}
_ADAPTERS: dict[str, TypeAdapter[Any]] = {topic: TypeAdapter(row) for topic, row in TOPICS.items()}
_DIRECTIONS = {str(direction): direction for direction in Direction}


def encode(row: Row) -> bytes:
    """The row as JSON, without its time. Equal rows are equal bytes."""
    if isinstance(row, SignalRow):
        return to_json({"direction": row.direction, **row.values})
    return _ADAPTERS[row.topic].dump_json(row, exclude={"time_ns"}, exclude_none=True)


def decode(topic: str, time_ns: int, data: bytes) -> Row:
    """The row that `encode` made. Raises ValueError that names topic and field for anything else."""
    fields = from_json(data)
    if not isinstance(fields, dict):
        raise ValueError(f"{topic}: not a JSON object")
    return from_fields(topic, time_ns, fields)


def from_fields(topic: str, time_ns: int, fields: Mapping[str, Any]) -> Row:
    """The row with these JSON values. Raises ValueError that names topic and field."""
    if topic.startswith(SIGNAL_TOPICS):
        return _signals(topic, time_ns, fields)
    adapter = _ADAPTERS.get(topic)
    if adapter is None:
        raise ValueError(f"{topic}: no such topic")
    try:
        row: Row = adapter.validate_python({**fields, "time_ns": time_ns})
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"{topic}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    return row


def _signals(topic: str, time_ns: int, fields: Mapping[str, Any]) -> SignalRow:
    direction = _DIRECTIONS.get(str(fields.get("direction")))
    if direction is None:
        raise ValueError(f"{topic}: direction: neither rx nor tx")
    values = {name: value for name, value in fields.items() if name != "direction"}
    for name, value in values.items():
        if type(value) not in (int, float, str):
            raise ValueError(f"{topic}: {name}: neither a number nor a word")
    return SignalRow(time_ns, topic.removeprefix(SIGNAL_TOPICS), direction, values)


def is_topic(topic: str) -> bool:
    """Whether rows may stand there."""
    return topic in TOPICS or topic.startswith(SIGNAL_TOPICS)


def schema_name(topic: str) -> str:
    """What a topic's schema is called in a recording; viewers know some by name."""
    return str(getattr(TOPICS.get(topic), "schema", topic.strip("/")))


@cache
def json_schema(topic: str) -> dict[str, Any]:
    """The JSON schema of a topic's rows, with plain types: viewers list only fields that `properties` names so.

    It is made once: not to be changed.
    """
    schema = viewable(_ADAPTERS[topic].json_schema(mode="serialization"))
    del schema["properties"]["time_ns"]
    schema["required"] = [name for name in schema["required"] if name != "time_ns"]
    return schema
