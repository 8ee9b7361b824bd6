"""hilbridge.rows: every row comes back as it was, equal rows are equal bytes, other content is refused by name."""

from __future__ import annotations

import dataclasses
import json
import math

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.rows import TOPICS, EventRow, Row, TickRow, decode, encode, json_schema

TEXT = st.text(st.characters(codec="utf-8"))
FINITE = st.floats(allow_nan=False, allow_infinity=False)
ROWS = st.one_of([st.builds(row, time_ns=st.integers(0, 2**63 - 1)) for row in TOPICS.values()])
st.register_type_strategy(float, FINITE)
st.register_type_strategy(str, TEXT)


@given(ROWS)
def test_a_row_comes_back_as_it_was(row: Row) -> None:
    data = encode(row)
    again = decode(row.topic, row.time_ns, data)
    assert again == row
    assert encode(again) == data


@given(ROWS)
def test_what_is_written_is_what_the_schema_says(row: Row) -> None:
    jsonschema.validate(json.loads(encode(row)), json_schema(row.topic))


@pytest.mark.parametrize("topic", TOPICS)
def test_a_schema_names_every_field_with_a_plain_type(topic: str) -> None:
    properties = json_schema(topic)["properties"]
    fields = {field.name for field in dataclasses.fields(TOPICS[topic])} - {"time_ns"}
    assert set(properties) == fields
    assert not any("anyOf" in part for part in properties.values())


def test_what_is_not_known_is_absent() -> None:
    assert "latency_ms" not in json.loads(
        encode(decode("/tick", 0, b'{"action":"HOLD","reason":"stale","confidence":0.5}'))
    )


@pytest.mark.parametrize(
    ("topic", "data", "said"),
    [
        ("/tock", b"{}", "/tock: no such topic"),
        ("/tick", b"[]", "/tick: not a JSON object"),
        ("/tick", b"{", "EOF"),
        ("/event", b"{}", "/event: text"),
        ("/tick", b'{"action":"GO","reason":"none","confidence":1}', "/tick: action"),
        ("/tick", b'{"action":"ACT","reason":"because","confidence":1}', "/tick: reason"),
        ("/can", b'{"direction":"rx","can_id":1,"data":"zz"}', "/can: data"),
    ],
)
def test_other_content_is_refused_by_name(topic: str, data: bytes, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        decode(topic, 0, data)


def test_a_number_that_is_none_is_not_written_as_one() -> None:
    tick = TickRow(0, *_held(), confidence=math.nan)
    assert b"NaN" not in encode(tick)
    with pytest.raises(ValueError, match="confidence"):
        decode("/tick", 0, encode(tick))


def test_rows_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        EventRow(0, "text").text = "other"  # type: ignore[misc]


def _held() -> tuple[object, ...]:
    from hilbridge.records import Action, HoldReason

    return Action.HOLD, HoldReason.STALE
