"""The device's part runs in a process of its own: what it says, how it ends, and that it never outlives the command."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hilbridge.errors import InputError
from hilbridge.tune import device
from hilbridge.tune.device import Asked, propose
from hilbridge.tune.motion import Motion

SECONDS = np.arange(0.0, 4.0, 0.01)
MOTION = Motion(
    "hand.csv", None, "", SECONDS, np.stack([np.sin(30.0 * SECONDS), SECONDS * 0.0, SECONDS * 0.0], axis=1), {}
)
RESULT = {"profiles": [{"profile": "reach"}], "old_text": "a", "new_text": "b", "old_hash": "A", "new_hash": "B"}


class Bar:
    """Counts."""

    def __init__(self) -> None:
        self.total = self.done = 0

    def __call__(self, total: int) -> Any:
        self.total = total
        return self.step

    def step(self) -> None:
        self.done += 1


def saying(monkeypatch: pytest.MonkeyPatch, *lines: dict[str, Any], after: str = "") -> None:
    """In place of the device's part: these lines for any request, then `after`."""
    text = "\n".join(map(json.dumps, lines))
    monkeypatch.setattr(device, "COMMAND", ("-c", f"import sys, json\njson.load(sys.stdin)\nprint({text!r})\n{after}"))


def test_trials_are_counted_and_the_result_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    saying(monkeypatch, {"of": 3}, {"tried": "reach"}, {"tried": "reach"}, {"result": RESULT})
    bar = Bar()
    found = propose(Asked(), [MOTION], bar)
    assert (bar.total, bar.done) == (3, 2)
    assert (found.rows, found.old_text, found.new_text, found.old_hash, found.new_hash) == (
        ({"profile": "reach"},),
        "a",
        "b",
        "A",
        "B",
    )


def test_what_it_cannot_use_is_its_own_line(monkeypatch: pytest.MonkeyPatch) -> None:
    saying(monkeypatch, {"of": 3}, {"error": "own.toml: no"}, after="sys.exit(2)")
    with pytest.raises(InputError, match=r"^own.toml: no$"):
        propose(Asked(), [MOTION], Bar())


def test_one_that_ends_early_is_a_defect_with_its_last_word(monkeypatch: pytest.MonkeyPatch) -> None:
    saying(monkeypatch, {"of": 3}, after="sys.stderr.write('one\\nlast word')\nsys.exit(1)")
    with pytest.raises(RuntimeError, match="the trials ended early: last word"):
        propose(Asked(), [MOTION], Bar())
    monkeypatch.setattr(device, "COMMAND", ("-c", "pass"))  # before it has read anything
    with pytest.raises(RuntimeError, match="the trials ended early: nothing was said"):
        propose(Asked(), [MOTION] * 20, Bar())


def test_who_is_interrupted_leaves_no_process_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    saying(monkeypatch, {"of": 3}, {"tried": "reach"}, after="sys.stdout.flush()\nimport time\ntime.sleep(600)")
    ended: list[int | None] = []
    real = device.subprocess.Popen

    class Kept(real):  # type: ignore[misc, valid-type]  # looked at below
        def __exit__(self, *reason: Any) -> None:
            super().__exit__(*reason)
            ended.append(self.returncode)

    monkeypatch.setattr(device.subprocess, "Popen", Kept)

    def interrupt(total: int) -> Any:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        propose(Asked(), [MOTION], interrupt)
    assert len(ended) == 1
    assert ended[0] is not None


def test_the_devices_own_part_refuses_profiles_that_are_wider(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text("never = []\n")
    with pytest.raises(InputError, match=r"own.toml: `profile` = None: write sections"):
        propose(Asked(path), [MOTION], Bar())


def test_a_way_of_moving_that_nobody_knows_is_one_line() -> None:
    with pytest.raises(InputError, match="--control drunk: there are steady, weak, ataxic"):
        propose(Asked(control="drunk"), [MOTION], Bar())


def test_ways_of_moving_are_the_devices() -> None:
    from firmware_sim.plant.nerves import CONTROLS

    assert tuple(CONTROLS) == device.CONTROLS
