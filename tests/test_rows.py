"""hilbridge.rows: every row comes back as it was, equal rows are equal bytes, other content is refused by name."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.features.layout import D
from hilbridge.observe.keeping.pictures import PictureFormat, image_row
from hilbridge.observe.signals import SignalRows
from hilbridge.records import CameraFrame, FeatureVector, GazeSample, Hand, HandTracks, IntentEstimate
from hilbridge.rows import (
    TOPICS,
    BundleRow,
    ConfigRow,
    Direction,
    EventRow,
    Look,
    Row,
    SignalRow,
    TickRow,
    belief_row,
    decode,
    encode,
    estimate_of,
    feature_vector,
    features_row,
    gaze_row,
    gaze_sample,
    hand_tracks,
    hands_row,
    json_schema,
    schema_name,
    shifted,
)
from hilbridge.wire.codec import Codec

TEXT = st.text(st.characters(codec="utf-8"))
FINITE = st.floats(allow_nan=False, allow_infinity=False)
TIMES = st.integers(0, 2**63 - 1)
JSON = st.dictionaries(TEXT, st.one_of(st.booleans(), st.integers(-(2**53), 2**53), FINITE, TEXT, st.lists(FINITE)))
# Fields that may hold any JSON, which hypothesis cannot guess.
OPEN = {ConfigRow: {"settings": JSON}, BundleRow: {"provenance": st.none() | JSON}}
ROWS = st.one_of([st.builds(row, time_ns=TIMES, **OPEN.get(row, {})) for row in TOPICS.values()])
WORDS = st.dictionaries(TEXT.filter(lambda name: name != "direction"), st.one_of(FINITE, st.integers(-9, 2**53), TEXT))
SIGNALS = st.builds(SignalRow, TIMES, TEXT, st.sampled_from(Direction), WORDS)
st.register_type_strategy(float, FINITE)
st.register_type_strategy(str, TEXT)


@given(ROWS | SIGNALS)
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


@given(st.lists(st.floats(width=32, allow_nan=False, allow_infinity=False), min_size=D, max_size=D), TIMES)
def test_features_come_back_to_the_last_bit(numbers: list[float], now_ns: int) -> None:
    vector = FeatureVector(now_ns - 5, now_ns, np.array(numbers, np.float32), (True, False, True))
    row = features_row(Look(now_ns, vector, 7, GazeSample(3, 0.5, 0.5, True), None))
    again = decode(row.topic, now_ns, encode(row))
    assert again == row
    back = feature_vector(again)  # type: ignore[arg-type]
    assert back.values.tobytes() == vector.values.tobytes()
    assert (back.oldest_input_ns, back.captured_ns, back.valid) == (now_ns - 5, now_ns, (True, False, True))


@given(st.lists(st.floats(0, 1), min_size=21, max_size=21), st.floats(0, 1), st.integers(0, 20))
def test_a_belief_comes_back_to_the_last_bit(numbers: list[float], confidence: float, verb: int) -> None:
    estimate = IntentEstimate(1, 2, tuple(numbers), verb, confidence, 0xBEEF, (True, True, False))
    row = belief_row(estimate, 3)
    assert estimate_of(decode(row.topic, 3, encode(row))) == estimate  # type: ignore[arg-type]


def test_what_a_sensor_gave_comes_back_and_what_is_no_number_is_absent() -> None:
    for sample in (GazeSample(5, 0.25, 0.75, True), GazeSample(5, math.nan, math.inf, True)):
        row = gaze_row(sample, 9)
        back = gaze_sample(decode(row.topic, 9, encode(row)))  # type: ignore[arg-type]
        assert (back.captured_ns, back.valid) == (5, True)
        assert math.isfinite(back.x) == math.isfinite(sample.x)
        assert back == sample or not math.isfinite(sample.x)
    tracks = HandTracks(5, (Hand(0.1, 0.2, 0.9, (0.1, 0.2, 0.3)), Hand(0.5, 0.6, 0.7)))
    found = hands_row(tracks, 9)
    assert hand_tracks(decode(found.topic, 9, encode(found))) == tracks  # type: ignore[arg-type]


@given(ROWS | SIGNALS, st.integers(0, 2**40))
def test_a_shifted_row_is_the_same_later(row: Row, by_ns: int) -> None:
    later = shifted(row, by_ns)
    assert later.time_ns == row.time_ns + by_ns
    assert shifted(later, -by_ns).time_ns == row.time_ns
    assert type(later) is type(row)


def _numbers(schema: dict[str, Any], path: str = "") -> list[str]:
    """Fields that can be plotted, as Foxglove reads a schema; fails on what makes it give up the whole topic."""
    found = []
    for name, part in schema["properties"].items():
        kind = part["type"]
        assert kind in ("boolean", "string", "integer", "number", "object", "array"), f"{path}.{name}: {kind}"
        assert "$ref" not in part
        if kind in ("integer", "number"):
            found.append(f"{path}.{name}")
        elif kind == "object" and "properties" in part:
            found += _numbers(part, f"{path}.{name}")
        elif kind == "array":
            assert part["items"]["type"] not in ("array", None)
            if part["items"]["type"] == "object":
                _numbers(part["items"], f"{path}.{name}[]")
            elif part["items"]["type"] in ("integer", "number"):
                found.append(f"{path}.{name}[]")
    return found


def test_viewers_find_numbers_to_plot() -> None:
    found = [field for topic in TOPICS for field in _numbers(json_schema(topic), topic)]
    signals = [field for topic, schema in SignalRows(Codec()).schemas.items() for field in _numbers(schema, topic)]
    ticks = [field for field in found if field.startswith("/tick")]
    assert len(ticks) >= 8
    assert len(ticks) + len(signals) >= 40
    assert {"/tick.confidence", "/tick.tau_on", "/device.assist_nm", "/belief.probabilities[]"} <= set(found)
    assert "/signal/ACT_CMD.Confidence" in signals


def test_a_picture_is_what_foxglove_calls_one() -> None:
    schema = json_schema("/camera")
    assert schema_name("/camera") == "foxglove.CompressedImage"
    assert schema["properties"]["data"] == {"type": "string", "contentEncoding": "base64"}
    assert set(schema["properties"]["timestamp"]["properties"]) == {"sec", "nsec"}
    picture = image_row(CameraFrame(1_500_000_001, np.zeros((48, 64, 3), np.uint8), 4), PictureFormat(), 9)
    assert json.loads(encode(picture))["timestamp"] == {"sec": 1, "nsec": 500_000_001}


def _held() -> tuple[object, ...]:
    from hilbridge.records import Action, HoldReason

    return Action.HOLD, HoldReason.STALE
