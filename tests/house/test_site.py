"""The site builds without a warning, its pages of code are whole, and every command line in the documents is one."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from firmware_sim.node import _parser
from hilbridge import cli
from hilscenario import cli as scenario_cli

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "decisions").glob("*.md")])
APPS = {"hilbridge": cli.app, "hilscenario": scenario_cli.app}
_ENDS = (";", "&&", "||", "|", "&", ">")


def command_lines() -> list[tuple[str, str]]:
    """(page, line) of each of our commands that stands in a block of a page."""
    found = []
    for page in PAGES:
        for line in _shell_lines(page.read_text(encoding="utf-8")):
            for part in re.split(r"&&|\|\||;|\|", line.split("#")[0]):
                if part.strip().split(" ")[0] in (*APPS, "firmware-sim"):
                    found.append((page.name, part.strip().rstrip("&").strip()))
    return found


def _shell_lines(text: str) -> Iterator[str]:
    """Lines of the blocks that are marked as of a shell."""
    language: str | None = None
    for line in text.replace("\\\n", " ").splitlines():
        if line.startswith("```"):
            language = line[3:].strip() if language is None else None
        elif language in ("sh", "bash", "console"):
            yield line


LINES = command_lines()


def test_there_are_command_lines_to_look_at() -> None:
    assert len(LINES) > 40


@pytest.mark.parametrize(("page", "line"), LINES, ids=[f"{page}: {line}"[:90] for page, line in LINES])
def test_a_command_line_in_a_page_is_one_that_the_program_takes(page: str, line: str) -> None:
    """Options and their values are parsed as at a start; nothing is run. `[...]` says what may be left out."""
    words = shlex.split(re.sub(r"\[[^\]]*\]", "", line))
    words = words[: next((place for place, word in enumerate(words) if word in _ENDS), len(words))]
    if words[0] == "firmware-sim":
        _parser().parse_args(words[1:])
        return
    command = typer.main.get_command(APPS[words[0]])
    context = command.make_context(words[0], words[1:])
    while hasattr(context.command, "get_command"):
        arguments = [*context._protected_args, *context.args]
        if not arguments:
            return
        found = context.command.get_command(context, arguments[0])
        assert found is not None, f"{page}: no command {arguments[0]}"
        context = found.make_context(arguments[0], arguments[1:], parent=context)


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    pages = {
        name: (tmp_path / "reference" / name / "index.html").read_text() for name in ("commands", "rows", "faults")
    }
    assert "hilbridge conformance" in pages["commands"]
    assert "float range" in pages["commands"]
    assert "bound method" not in pages["commands"]
    assert "What the gate compares with its thresholds" in pages["rows"]
    assert "zero_after_fault_ms" in pages["faults"]
