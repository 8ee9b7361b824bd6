"""A trouble is told once when it begins and once when it is over."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from hilbridge.runtime.account.spells import QUIET_NS, Spell

MS = 1_000_000


def test_one_line_at_the_beginning_and_one_with_the_duration_at_the_end() -> None:
    spell = Spell()
    said = [spell.look("camera silent" if 1000 <= ms < 3000 else None, ms * MS) for ms in range(0, 6000, 40)]
    assert [text for text in said if text] == ["camera silent", "over after 2.00 s: camera silent"]


def test_what_comes_back_within_the_quiet_time_is_the_same_spell() -> None:
    spell = Spell()
    said = [spell.look("camera silent" if ms % 80 == 0 and ms < 4000 else None, ms * MS) for ms in range(0, 8000, 40)]
    assert len([text for text in said if text]) == 2


@given(st.lists(st.sampled_from([None, "a", "b"]), max_size=400))
def test_never_more_lines_than_troubles_and_ends(troubles: list[str | None]) -> None:
    spell = Spell()
    said = [text for k, trouble in enumerate(troubles) if (text := spell.look(trouble, k * 40 * MS))]
    spells = sum(text.startswith("over") for text in said)
    assert len(said) <= 3 * (spells + 1)
    assert spells <= len(troubles) * 40 * MS // QUIET_NS
