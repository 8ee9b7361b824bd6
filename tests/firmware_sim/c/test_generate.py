"""The generated tables are those of the Python sources."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_sim import profiles
from firmware_sim.c import generate


@pytest.mark.parametrize("path", list(generate.made()), ids=lambda path: path.name)
def test_no_generated_file_is_stale(path: Path) -> None:
    assert path.read_text() == generate.made()[path], "run `python -m firmware_sim.c.generate`"


def test_a_changed_profile_changes_the_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    before = generate.source()
    monkeypatch.setitem(profiles._BY_CODE, 4, profiles.profile(1))
    assert generate.source() != before


def test_a_name_with_two_values_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generate.damping, "RAMP_TICKS", 41, raising=False)
    with pytest.raises(ValueError, match="RAMP_TICKS has two values"):
        generate.header()
