"""The generated tables are those of the Python sources."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_sim import profiles
from firmware_sim.c import generate
from firmware_sim.profile_file import kinds_in, profiles_of


@pytest.mark.parametrize("path", list(generate.made()), ids=lambda path: path.name)
def test_no_generated_file_is_stale(path: Path) -> None:
    assert path.read_text() == generate.made()[path], "run `python -m firmware_sim.c.generate`"


def test_a_changed_profile_changes_the_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    before, hashed = generate.source(), generate.header()
    reach, *others = kinds_in()
    other = profiles_of([reach._replace(profile=reach.profile._replace(cap_unm=1_000_000)), *others])
    monkeypatch.setattr(profiles, "shipped", lambda: other)
    assert generate.source() != before
    assert generate.header() != hashed
    assert f"#define CTL_PROFILES_HASH 0x{other.hash32:08X}U\n" in generate.header()


def test_a_name_with_two_values_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generate.damping, "RAMP_TICKS", 41, raising=False)
    with pytest.raises(ValueError, match="RAMP_TICKS has two values"):
        generate.header()
