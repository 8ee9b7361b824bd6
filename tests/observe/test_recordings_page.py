"""docs/recordings.md and the Foxglove layout are held to what recordings hold."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from hilbridge.observe.signals import SignalRows
from hilbridge.rows import SIGNAL_TOPICS, TOPICS, json_schema
from hilbridge.wire.codec import Codec

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_the_page_names_every_topic() -> None:
    page = (DOCS / "recordings.md").read_text(encoding="utf-8")
    table = page.partition("<!-- topics -->")[2].partition("<!-- end of topics -->")[0]
    assert set(re.findall(r"^\| `([^`]+)`", table, re.MULTILINE)) == {*TOPICS, SIGNAL_TOPICS + "MESSAGE"}


def _paths(value: Any) -> list[str]:
    """Every message path of a layout: a topic, and mostly a field."""
    if isinstance(value, dict):
        own = [value[key] for key in ("value", "topicPath", "imageTopic") if isinstance(value.get(key), str)]
        return own + [path for part in value.values() for path in _paths(part)]
    return [path for part in value for path in _paths(part)] if isinstance(value, list) else []


def test_every_path_of_the_layout_is_in_a_recordings_schemas() -> None:
    layout = json.loads((DOCS / "foxglove-layout.json").read_text(encoding="utf-8"))
    schemas = {**{topic: json_schema(topic) for topic in TOPICS}, **SignalRows(Codec()).schemas}
    paths = _paths(layout["configById"])
    assert len(paths) >= 15
    for path in paths:
        topic, _, field = path.partition(".")
        assert topic in schemas, path
        assert not field or field in schemas[topic]["properties"], path
    shown = set(re.findall(r'"(\w+!\w+)"', json.dumps(layout["layout"])))
    assert shown == set(layout["configById"])
    assert {"/camera", "/tick.confidence", "/tick.tau_on", "/device.state", "/device.assist_nm"} <= set(paths)
