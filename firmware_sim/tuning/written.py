"""The text of a profiles.toml with other numbers in it, all else as it was: what a clinician reads as a diff."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass

from firmware_sim.profile_file import NUMBERS, Kind, ProfilesUnusable, checked, profiles_of, refuse_wider
from firmware_sim.tuning.search import Proposal

_CHANGED = ("damping_mnms_rad", "damping_near_mnms_rad", "cap_mnm")


@dataclass(frozen=True)
class Written:
    """A file before and after, and the hashes of what both say."""

    old_text: str
    new_text: str
    old_hash: str
    new_hash: str


def written(text: str, name: str, proposals: Sequence[Proposal]) -> Written:
    """The file `name`, whose text this is, with what is proposed. Read again, it must say exactly that and be no wider.

    Raises ProfilesUnusable for a file laid out so that a line cannot be changed by itself.
    """
    new, wanted = text, []
    for one in proposals:
        kind, profile = one.kind, one.profile
        wanted.append(Kind(kind.name, () if profile is None else kind.verbs, profile or kind.profile))
        if profile is None:
            new = _with(new, kind.name, "verbs", "[]")
            new = _never(new, kind.verbs)
        else:
            for key in _CHANGED:
                number = NUMBERS[key]
                new = _with(new, kind.name, key, str(int(getattr(profile, number.field)) // number.scale))
    before = profiles_of([one.kind for one in proposals])
    after = profiles_of(wanted)
    try:
        same = profiles_of(checked(tomllib.loads(new), name)) == after
    except (tomllib.TOMLDecodeError, ProfilesUnusable):
        same = False
    if not same:
        raise ProfilesUnusable(
            f"{name}: its numbers cannot be changed line by line; write `key = value` lines as the file that ships has"
        )
    refuse_wider(after, before, name)
    return Written(text, new, f"{before.hash32:08X}", f"{after.hash32:08X}")


def _with(text: str, section: str, key: str, value: str) -> str:
    """One value of one section; what stands behind it on its line stays. A text without it is given back as it is."""
    header = rf"^\[profile\.{re.escape(section)}\][^\n]*\n"
    found = re.search(rf"{header}(?:(?!\[)[^\n]*\n)*?{key} = (?P<value>\[[^\]]*\]|[^\s#]+)", text, re.MULTILINE)
    return text if found is None else text[: found.start("value")] + value + text[found.end("value") :]


def _never(text: str, verbs: Sequence[str]) -> str:
    """More verbs under `never`."""
    found = re.search(r"^never = \[(?P<verbs>[^\]]*)\]", text, re.MULTILINE)
    if found is None:
        return text
    had = found["verbs"].strip().rstrip(",")
    more = ", ".join([had, *(f'"{verb}"' for verb in verbs)]) if had else ", ".join(f'"{verb}"' for verb in verbs)
    return f"{text[: found.start('verbs')]}{more}{text[found.end('verbs') :]}"
