"""Marks of a running session from a real LSL outlet and a real terminal."""

import asyncio
import io
import os
import pty
import sys
import uuid

import pytest

from hilbridge.errors import InputError
from hilbridge.labels import live
from hilbridge.labels.live import MarkOptions, marking
from hilbridge.rows import LabelRow, Row


async def until(rows: list[Row], count: int) -> None:
    while len(rows) < count:
        await asyncio.sleep(0.01)


async def test_an_lsl_marker_stream_marks(monkeypatch):
    pylsl = pytest.importorskip("pylsl")
    name = f"marks-{uuid.uuid4().hex[:8]}"
    outlet = pylsl.StreamOutlet(pylsl.StreamInfo(name, "Markers", 1, 0, "string", name))
    rows: list[Row] = []
    notices: list[str] = []
    async with marking(MarkOptions(lsl=name), rows.append, notices.append):
        await asyncio.to_thread(outlet.wait_for_consumers, 30)
        begin_s = pylsl.local_clock()
        for after_s, word in ((0.0, "Pour"), (0.25, "Fly"), (0.5, "stop")):
            outlet.push_sample([word], begin_s + after_s)
        await asyncio.wait_for(until(rows, 1), 60)
    (label,) = rows
    assert isinstance(label, LabelRow)
    assert (label.verb, label.source) == ("Pour", f"lsl:{name}")
    assert abs(label.end_ns - label.time_ns - 500_000_000) < 5_000_000
    assert any("no verb" in notice for notice in notices)


async def test_a_stream_that_is_not_there_is_one_line(monkeypatch):
    pytest.importorskip("pylsl")
    monkeypatch.setattr(live, "_LSL_WAIT_S", 0.2)
    with pytest.raises(InputError, match="no such stream"):
        await marking(MarkOptions(lsl="nobody"), print, print).__aenter__()


async def test_keys_need_a_terminal(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    with pytest.raises(InputError, match="no terminal"):
        await marking(MarkOptions({"p": "Pour"}), print, print).__aenter__()


async def test_keys_of_a_terminal_mark_and_it_is_left_as_it_was(monkeypatch):
    import termios

    ours, theirs = pty.openpty()
    before = termios.tcgetattr(theirs)
    rows: list[Row] = []
    with os.fdopen(theirs) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        monkeypatch.setattr(os, "tcgetpgrp", lambda descriptor: os.getpgrp())
        async with marking(MarkOptions({"p": "Pour", "c": "Cut"}), rows.append, lambda text: None):
            os.write(ours, b"pzc")
            await asyncio.wait_for(until(rows, 1), 60)
            os.write(ours, b"c")
            await asyncio.wait_for(until(rows, 2), 60)
        assert termios.tcgetattr(theirs) == before
    os.close(ours)
    assert [row.verb for row in rows if isinstance(row, LabelRow)] == ["Pour", "Cut"]
