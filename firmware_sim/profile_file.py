"""profiles.toml: read and checked. Whatever is not known to be within the contract is refused, in one line.

A file of one's own may only be tighter than the one that ships, verb by verb.
`python -m firmware_sim.profile_file [FILE]` says whether a file can be used, and its hash; `--text` prints the one that ships.
"""

from __future__ import annotations

import difflib
import hashlib
import sys
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from firmware_sim.assist_profile import NONE, Guidance, Profile, Profiles

SHIPPED = Path(str(files("firmware_sim") / "profiles.toml"))
MOST_BYTES = 64 << 10
_MOST_SHOWN = 60
CODES = 32  # values that a verb on the bus may have
# As the DBC calls them; a verb's code is its place and one.
VERBS = (
    "Take", "Put", "Open", "Cut", "Move Around", "Inspect/Read", "Close", "Wash", "Transfer", "Pour", "Clean/Wipe",
    "Divide/Pull Apart", "Turn on", "Operate", "Mix", "Squeeze", "Spread", "Turn off", "Compress", "Dry", "Crack",
)  # fmt: skip
GUIDANCE = {"never": Guidance.NEVER, "minimum-jerk": Guidance.MINIMUM_JERK, "until-contact": Guidance.UNTIL_CONTACT}


class ProfilesUnusable(ValueError):
    """The file cannot be used; the message is one line that names file, key, value and a cure."""

    def __init__(self, text: str) -> None:
        ValueError.__init__(self, " ".join(text.split()))


class Number(NamedTuple):
    """A number of the file: the field of Profile that it becomes, times `scale`, and what the contract allows."""

    field: str
    scale: int
    lowest: int
    highest: int


# No file goes beyond these, not even the one that ships. Damping, cap and ramps: the contract's profile table, its smallest and
# largest. Drag and gravity: what decision 109 leaves of it. Half waves: tremor is 3 to 12 Hz and a little below (decision 110).
# A ramp may be gentler than the table's, up to its longest.
NUMBERS = {
    "damping_mnms_rad": Number("damping", 1, 0, 5000),
    "damping_near_mnms_rad": Number("damping_near", 1, 0, 5000),
    "drag_mnm": Number("drag_unm", 1000, 0, 30),
    "half_wave_ms": Number("half_wave_ms", 1, 40, 180),
    "gravity_per_mille": Number("gravity_per_mille", 1, 0, 40),
    "cap_mnm": Number("cap_unm", 1000, 1, 2000),
    "ramp_in_ms": Number("ramp_in_ms", 1, 300, 500),
    "ramp_out_ms": Number("ramp_out_ms", 1, 150, 500),
}
_KEYS = ("verbs", "guidance", *NUMBERS)
_AT_MOST = ("damping_mnms_rad", "damping_near_mnms_rad", "drag_mnm", "half_wave_ms", "gravity_per_mille", "cap_mnm")


class Kind(NamedTuple):
    """A section of the file: verbs that are assisted alike."""

    name: str
    verbs: tuple[str, ...]
    profile: Profile


def read(path: Path = SHIPPED) -> Profiles:
    """The profiles of a file. Raises ProfilesUnusable."""
    return profiles_of(kinds_in(path))


def kinds_in(path: Path = SHIPPED) -> tuple[Kind, ...]:
    """The sections of a file, checked, in its order. Raises ProfilesUnusable."""
    try:
        with path.open("rb") as file:
            raw = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise ProfilesUnusable(f"{path}: cannot be read ({error.strerror}); name a profiles.toml") from None
    if len(raw) > MOST_BYTES:
        raise ProfilesUnusable(f"{path}: more than {MOST_BYTES} bytes, larger than any profiles; name a profiles.toml")
    try:
        data = tomllib.loads(raw.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:  # no UTF-8, no TOML, or a number that no file needs
        raise ProfilesUnusable(f"{path}: not readable as TOML ({error}); start from the file that ships") from None
    return checked(data, str(path))


def checked(data: Mapping[str, object], name: str) -> tuple[Kind, ...]:
    """The sections of what a file called `name` holds. Raises ProfilesUnusable."""
    _refuse_unknown(data, ("never", "profile"), name, "")
    sections = data.get("profile")
    if not isinstance(sections, dict):
        raise ProfilesUnusable(
            f"{name}: `profile` = {_shown(sections)}: write sections [profile.NAME] as the file that ships has"
        )
    kinds = tuple(_kind(section, title, name) for title, section in sections.items())
    said = [(verb, "never") for verb in _verbs(data.get("never", []), "never", name)]
    said += [(verb, f"profile.{kind.name}") for kind in kinds for verb in kind.verbs]
    places: dict[str, str] = {}
    for verb, place in said:
        if verb in places:
            raise ProfilesUnusable(f"{name}: `{place}` has {verb!r}, as `{places[verb]}` has; name each verb once")
        places[verb] = place
    for verb in VERBS:
        if verb not in places:
            raise ProfilesUnusable(f"{name}: {verb!r} is missing; add it to the verbs of a profile or to `never`")
    return kinds


def _kind(section: object, title: str, name: str) -> Kind:
    where = f"profile.{title}"
    if not isinstance(section, dict):
        raise ProfilesUnusable(f"{name}: `{where}` = {_shown(section)}: write it as a section [{where}]")
    _refuse_unknown(section, _KEYS, name, f"{where}.")
    for key in _KEYS:
        if key not in section:
            raise ProfilesUnusable(f"{name}: `{where}.{key}` is missing; the file that ships says what is usual")
    verbs = _verbs(section["verbs"], f"{where}.verbs", name)
    fields: dict[str, int] = {
        number.field: number.scale * _whole(section[key], number, f"{where}.{key}", name)
        for key, number in NUMBERS.items()
    }
    guidance = section["guidance"]
    if not isinstance(guidance, str) or guidance not in GUIDANCE:
        raise ProfilesUnusable(f"{name}: `{where}.guidance` = {_shown(guidance)}: give one of {', '.join(GUIDANCE)}")
    return Kind(title, tuple(verbs), Profile(guidance=GUIDANCE[guidance], **fields))


def _whole(value: object, number: Number, where: str, name: str) -> int:
    """A number within its limits; one that is no whole number, NaN among them, is none."""
    if type(value) is not int:
        raise ProfilesUnusable(f"{name}: `{where}` = {_shown(value)}: give a whole number")
    if not number.lowest <= value <= number.highest:
        raise ProfilesUnusable(
            f"{name}: `{where}` = {_shown(value)}: beyond the contract; give {number.lowest} to {number.highest}"
        )
    return value


def _verbs(found: object, where: str, name: str) -> list[str]:
    if not isinstance(found, list):
        raise ProfilesUnusable(f"{name}: `{where}` = {_shown(found)}: give a list of verbs")
    for verb in found:
        if verb not in VERBS:
            raise ProfilesUnusable(
                f"{name}: `{where}` has {_shown(verb)}, which is no verb; {_nearest(_shown(verb), VERBS)}"
            )
    return found


def _refuse_unknown(data: Mapping[str, object], known: Sequence[str], name: str, where: str) -> None:
    for key in data:
        if key not in known:
            raise ProfilesUnusable(f"{name}: unknown key `{where}{key}` = {_shown(data[key])}; {_nearest(key, known)}")


def _shown(value: object) -> str:
    """A value as an error shows it."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):
        return "more than can be shown"
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}..."


def _nearest(word: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(word, known)
    return f"did you mean `{near[0]}`?" if near else f"known here: {', '.join(known)}"


def profiles_of(kinds: Iterable[Kind]) -> Profiles:
    """By code, with the hash over what they come to: comments, order and spelling of a file are not in it."""
    by_verb = {verb: kind.profile for kind in kinds for verb in kind.verbs}
    by_code = (NONE, *(by_verb.get(verb, NONE) for verb in VERBS))
    by_code += (NONE,) * (CODES - len(by_code))
    lines = (" ".join(map(str, (code, *map(int, one)))) for code, one in enumerate(by_code))
    return Profiles(by_code, hashlib.sha256("\n".join(lines).encode("ascii")).hexdigest())


def refuse_wider(found: Profiles, limits: Profiles, name: str) -> None:
    """Raises ProfilesUnusable where a verb would be assisted otherwise than less: `limits` are those that ship.

    A verb may always be never assisted. Guidance may go; a ramp in may be longer; the ramp out, of which neither more nor less
    is known to be safer, stays.
    """
    for code, verb in enumerate(VERBS, 1):
        own, limit = found.of(code), limits.of(code)
        if own == NONE:
            continue
        if limit == NONE:
            raise ProfilesUnusable(f"{name}: {verb!r} is never assisted in the profiles that ship; move it to `never`")
        if (wider := _wider(own, limit)) is not None:
            raise ProfilesUnusable(f"{name}: {wider} for {verb!r}, a file of one's own may only be tighter")


def _wider(own: Profile, limit: Profile) -> str | None:
    """What is wider in a profile than in another, and how far it may go."""
    for key in (*_AT_MOST, "ramp_in_ms", "ramp_out_ms"):
        number = NUMBERS[key]
        here, there = (int(getattr(one, number.field)) for one in (own, limit))
        shown, most = here // number.scale, there // number.scale
        if key in _AT_MOST and here > there:
            return f"`{key}` = {shown}: at most {most}"
        if key == "ramp_in_ms" and here < there:
            return f"`{key}` = {shown}: at least {most}"
        if key == "ramp_out_ms" and here != there:
            return f"`{key}` = {shown}: {most} and nothing else"
    if own.guidance not in (Guidance.NEVER, limit.guidance):
        words = {value: word for word, value in GUIDANCE.items()}
        return f"`guidance` = {words[own.guidance]!r}: {words[limit.guidance]!r} or 'never'"
    return None


def read_own(path: Path | None) -> Profiles:
    """Profiles of a file of one's own, which may only be tighter than those that ship; None: those. Raises ProfilesUnusable."""
    found = read(path or SHIPPED)
    refuse_wider(found, read(), str(path))
    return found


def said(profiles: Profiles) -> str:
    """Their hash, and how many verbs are assisted."""
    return f"{profiles.hash32:08X}, {sum(one != NONE for one in profiles.by_code)} verbs assisted"


def main(arguments: list[str]) -> int:
    """Check a file, or the one that ships, or print that; 0 where it can be used, 2 with one line where not."""
    if arguments == ["--text"]:
        print(SHIPPED.read_text(encoding="utf-8"), end="")  # noqa: T201
        return 0
    try:
        found = read_own(Path(arguments[0]) if arguments else None)
    except ProfilesUnusable as error:
        print(error, file=sys.stderr)  # noqa: T201
        return 2
    print(said(found))  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
