"""observe.signals: frames in words, both ways; what was rejected or never went out has none."""

from __future__ import annotations

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.observe.signals import SignalRows
from hilbridge.rows import CanRow, Direction, EventRow, SignalRow, encode
from hilbridge.wire.codec import Codec

CODEC = Codec()
ROWS = SignalRows(CODEC)
ACT_CMD = CODEC.messages["ACT_CMD"].can_id
DATA = CODEC.encode("ACT_CMD", {"Gate": "Act", "Verb": "Pour", "Confidence": 87, "SensingAge": 30})


def test_a_frame_has_numbers_and_words() -> None:
    row = ROWS.of(CanRow(7, Direction.TX, ACT_CMD, DATA, None, "sent"))
    assert isinstance(row, SignalRow)
    assert (row.topic, row.time_ns, row.direction) == ("/signal/ACT_CMD", 7, Direction.TX)
    assert row.values["Confidence"] == 87
    assert row.values["Gate_text"] == "Act"
    assert isinstance(row.values["Gate"], int)
    assert row.values["SensingAge"] == 30


@pytest.mark.parametrize(
    "row",
    [
        CanRow(7, Direction.RX, ACT_CMD, DATA),  # rejected: it has no name
        CanRow(7, Direction.TX, ACT_CMD, DATA, None, "full"),
        CanRow(7, Direction.TX, ACT_CMD, DATA, None, "listen_only"),
        CanRow(7, Direction.TX, 0x7FF, DATA, None, "sent"),
        CanRow(7, Direction.TX, ACT_CMD, DATA[:4], None, "sent"),
        CanRow(7, Direction.RX, ACT_CMD, DATA, "ACT_CMD", is_error=True),
        EventRow(7, "x"),
    ],
)
def test_what_says_nothing_has_no_signals(row: CanRow | EventRow) -> None:
    assert ROWS.of(row) is None


@given(st.sampled_from(sorted(CODEC.messages)), st.binary(min_size=8, max_size=8), st.sampled_from(Direction))
def test_every_frame_is_as_its_schema_says_or_has_no_signals(name: str, data: bytes, direction: Direction) -> None:
    message = CODEC.messages[name]
    row = ROWS.of(CanRow(1, direction, message.can_id, data[: message.length], name))
    if isinstance(row, SignalRow):
        import json

        jsonschema.validate(json.loads(encode(row)), {**ROWS.schemas[row.topic], "additionalProperties": False})
