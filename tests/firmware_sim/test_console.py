"""The device's terminal: read only when asked for and in the foreground; closed, foreign or absent it is no end."""

from __future__ import annotations

import io
import os
import pty
from collections.abc import Iterator
from typing import IO

import pytest

from firmware_sim import console
from firmware_sim.console import listen, report_defect, say


class Heard:
    """What was taken, and whether the end was told."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.ended = False

    def end(self) -> None:
        self.ended = True


@pytest.fixture
def terminal() -> Iterator[IO[str]]:
    ours, theirs = pty.openpty()
    os.write(ours, b"clear\n")
    with os.fdopen(theirs, encoding="utf-8") as stream:
        yield stream
    os.close(ours)


def test_a_pipe_is_read_to_its_end_without_being_asked() -> None:
    heard = Heard()
    listen(io.StringIO("stuck\n\nmend\n"), heard.lines.append, interactive=False, ended=heard.end)
    assert heard.lines == ["stuck\n", "mend\n"]
    assert heard.ended


def test_a_terminal_is_left_alone_unless_asked(terminal: IO[str]) -> None:
    heard = Heard()
    listen(terminal, heard.lines.append, interactive=False, ended=heard.end)
    assert heard.lines == []
    assert not heard.ended


def test_a_terminal_is_read_in_the_foreground_only(terminal: IO[str], monkeypatch: pytest.MonkeyPatch) -> None:
    looks = iter([False, False, True])
    waits: list[float] = []
    monkeypatch.setattr(console, "_in_foreground", lambda source: next(looks))
    monkeypatch.setattr(console.time, "sleep", waits.append)
    heard = Heard()

    def take(line: str) -> None:
        heard.lines.append(line)
        terminal.close()
        monkeypatch.setattr(console, "_in_foreground", lambda source: True)

    listen(terminal, take, interactive=True, ended=heard.end)
    assert heard.lines == ["clear\n"]
    assert len(waits) == 2


def test_a_program_without_input_hears_nothing() -> None:
    heard = Heard()
    listen(None, heard.lines.append, interactive=True, ended=heard.end)
    assert not heard.ended


def test_a_closed_terminal_does_not_end_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    closed = io.StringIO()
    closed.close()
    monkeypatch.setattr("sys.stdout", closed)
    say("ready")


def test_a_defect_is_one_line_that_names_its_trace(capsys: pytest.CaptureFixture[str]) -> None:
    assert report_defect(KeyError("nobody\nforesaw this")) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "KeyError" in said
    name = said.rsplit(" ", 1)[1].strip()
    with open(name, encoding="utf-8") as log:  # noqa: PTH123
        assert "KeyError" in log.read()
    os.unlink(name)  # noqa: PTH108
