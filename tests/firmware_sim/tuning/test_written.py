"""The file with what was proposed: other numbers, all else as it was; and nothing that would read otherwise."""

from __future__ import annotations

import difflib
import tomllib

import pytest

from firmware_sim.assist_profile import NONE
from firmware_sim.profile_file import SHIPPED, Kind, ProfilesUnusable, checked, kinds_in, profiles_of, read
from firmware_sim.tuning.search import Proposal
from firmware_sim.tuning.trial import Figures
from firmware_sim.tuning.written import written

TEXT = SHIPPED.read_text(encoding="utf-8")
FIGURES = Figures(0.5, 0.3, 0.01, 5.0)
POUR = 10


def proposals(**changes: dict[str, int] | None) -> list[Proposal]:
    """What is proposed: for each section named other numbers, or None for never."""
    made = []
    for kind in kinds_in():
        change = changes.get(kind.name, {})
        made.append(Proposal(kind, None if change is None else kind.profile._replace(**change), FIGURES, FIGURES))
    return made


def changed_lines(new: str) -> list[str]:
    lines = difflib.unified_diff(TEXT.splitlines(), new.splitlines(), lineterm="", n=0)
    return [line for line in lines if line[0] in "+-" and line[:3] not in ("+++", "---")]


def test_nothing_proposed_is_the_same_text() -> None:
    made = written(TEXT, "profiles.toml", proposals())
    assert (made.old_text, made.new_text) == (TEXT, TEXT)
    assert made.old_hash == made.new_hash == f"{read().hash32:08X}"


def test_only_the_lines_that_change_are_changed() -> None:
    made = written(TEXT, "profiles.toml", proposals(pour={"damping": 1250, "damping_near": 1250, "cap_unm": 200_000}))
    assert changed_lines(made.new_text) == [
        "-damping_mnms_rad = 5000",
        "-damping_near_mnms_rad = 5000",
        "+damping_mnms_rad = 1250",
        "+damping_near_mnms_rad = 1250",
        "-cap_mnm = 2000",
        "+cap_mnm = 200",
    ]
    found = profiles_of(checked(tomllib.loads(made.new_text), "new"))
    assert found.of(POUR).cap_unm == 200_000
    assert f"{found.hash32:08X}" == made.new_hash != made.old_hash


def test_h1_a_verb_that_nothing_is_good_enough_for_goes_to_never() -> None:
    made = written(TEXT, "profiles.toml", proposals(pour=None, cut=None))
    found = profiles_of(checked(tomllib.loads(made.new_text), "new"))
    assert found.of(POUR) == NONE
    assert [kind.verbs for kind in checked(tomllib.loads(made.new_text), "new") if kind.name in ("pour", "cut")] == [
        (),
        (),
    ]
    assert (
        'never = ["Move Around", "Pour", "Cut", "Divide/Pull Apart", "Squeeze", "Compress", "Crack"]' in made.new_text
    )
    assert f"{found.hash32:08X}" == made.new_hash


def test_an_empty_never_takes_its_first_verb() -> None:
    text = TEXT.replace('["Move Around"]', "[ ]").replace('["Operate"]', '["Operate", "Move Around"]')
    kinds = checked(tomllib.loads(text), "odd")
    made = written(
        text,
        "odd",
        [Proposal(kind, None if kind.name == "operate" else kind.profile, FIGURES, FIGURES) for kind in kinds],
    )
    assert 'never = ["Operate", "Move Around"]' in made.new_text


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("damping_mnms_rad = 5000", "damping_mnms_rad=5000"),
        ("[profile.pour]", "[ profile . pour ]"),
        ('never = ["Move Around"]', 'never=["Move Around"]'),
        ("[profile.pour]", '[profile."pour"]'),
    ],
)
def test_a_file_laid_out_otherwise_is_refused_and_not_half_changed(old: str, new: str) -> None:
    text = TEXT.replace(old, new)
    never = {"pour": None, "inspect": {"damping": 0}}
    with pytest.raises(
        ProfilesUnusable, match="odd: its numbers cannot be changed line by line; write `key = value` lines"
    ):
        written(text, "odd", proposals(**never))


def test_h4_what_would_widen_is_never_written() -> None:
    with pytest.raises(ProfilesUnusable, match="may only be tighter"):
        written(TEXT, "profiles.toml", proposals(cut={"cap_unm": 1_001_000}))


def test_a_section_is_found_by_its_whole_name() -> None:
    text = TEXT.replace("[profile.open]", "[profile.pour2]")
    kinds = [kind._replace(name="pour2") if kind.name == "open" else kind for kind in kinds_in()]
    changed: list[Kind] = [
        kind._replace(profile=kind.profile._replace(damping=1)) if kind.name == "pour" else kind for kind in kinds
    ]
    made = written(
        text,
        "x",
        [Proposal(kind, new.profile, FIGURES, FIGURES) for kind, new in zip(kinds, changed, strict=True)],
    )
    assert profiles_of(checked(tomllib.loads(made.new_text), "x")) == profiles_of(changed)
