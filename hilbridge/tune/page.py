"""What tuning came to, for people: a table old -> new with what each change buys, and a diff to be signed. Pure."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hilbridge.tune.device import Profiles
from hilbridge.tune.motion import Motion
from hilbridge.tune.threshold import Own, Threshold

TITLES = ("what", "old", "new", "what it buys")
_SHOWN = {"damping_mnms_rad": "damping, mN m s/rad", "cap_mnm": "cap, mN m"}
_SECTION = re.compile(r"^\[gate\][^\n]*\n", re.MULTILINE)
_TAU = re.compile(r"^tau_on *= *(?P<value>[^\s#]+)", re.MULTILINE)


def rows_of(threshold: Threshold, profiles: Profiles) -> list[tuple[str, str, str, str]]:
    """The table."""
    return [_threshold_row(threshold), *(row for one in profiles.rows for row in _profile_rows(one))]


def _threshold_row(one: Threshold) -> tuple[str, str, str, str]:
    before, after = one.before, one.after
    said = [one.why]
    if before is not None and after is not None:
        said.append(
            f"bundle's replay: precision {before.precision:.3f} -> {after.precision:.3f}, "
            f"coverage {before.coverage:.3f} -> {after.coverage:.3f}"
        )
    if one.own_before is not None and one.own_after is not None:
        said.append(f"own: {_own(one.own_before)} -> {_own(one.own_after)}")
    return "tau_on", f"{one.today:g}", f"{one.tau_on:g}", "; ".join(said)


def _own(one: Own) -> str:
    precision = "n/a" if one.precision is None else f"{one.precision:.3f}"
    return f"precision {precision}, coverage {one.acts / max(1, one.known):.3f} of {one.known} ticks"


def _profile_rows(one: Mapping[str, Any]) -> Iterator[tuple[str, str, str, str]]:
    name, old, new = one["profile"], one["old"], one["new"]
    if new is None:
        yield name, "assisted", "never", f"nothing keeps the bars; today: {_figures(one['old_figures'])}"
        return
    changed = [key for key in _SHOWN if old[key] != new[key]]
    gains = f"{_figures(one['old_figures'])} -> {_figures(one['new_figures'])}"
    if not changed:
        yield name, "", "as it is", _figures(one["old_figures"])
    for number, key in enumerate(changed):
        yield f"{name}: {_SHOWN[key]}", str(old[key]), str(new[key]), gains if number == 0 else "counted above"


def _figures(one: Mapping[str, Any]) -> str:
    return (
        f"tremor left {100 * one['left']:.0f} %, reach bent {one['distorted_deg']:.2f} deg, "
        f"false ACT {one['work_j']:.3f} J, {one['hand_mm']:.1f} mm"
    )


def config_with(text: str, tau_on: float) -> str:
    """A configuration with this threshold; all else stays. `precision` there is overruled by it."""
    section = _SECTION.search(text)
    if section is None:
        gap = "" if not text or text.endswith("\n\n") else "\n" if text.endswith("\n") else "\n\n"
        return f"{text}{gap}[gate]\ntau_on = {tau_on:g}\n"
    ends = text.find("\n[", section.end())
    body = text[section.end() : len(text) if ends < 0 else ends]
    found = _TAU.search(body)
    if found is None:
        return f"{text[: section.end()]}tau_on = {tau_on:g}\n{text[section.end() :]}"
    at = section.end()
    return f"{text[: at + found.start('value')]}{tau_on:g}{text[at + found.end('value') :]}"


def diff_of(name: str, old: str, new: str) -> str:
    """A unified diff that `patch` takes; nothing where nothing changes."""
    lines = difflib.unified_diff(old.splitlines(keepends=True), new.splitlines(keepends=True), name, name)
    return "".join(line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n" for line in lines)


def to_sign(
    person: str | None, motions: Sequence[Motion], bundle: str, profiles: Profiles, diffs: Sequence[str]
) -> str:
    """The diff under what it stands on and a line to sign. `patch` and `git apply` skip what is before the first ---."""
    lines = [
        f"Proposed by `hilbridge tune` for {person or 'a wearer whom no recording names'}; in force for nobody until signed.",
        "From simulated trials on recorded tremor. Nothing of it has been measured on a person.",
        f"Profiles {profiles.old_hash} -> {profiles.new_hash}, bundle {bundle}",
        *(f"{name} ({one.said}), SHA-256 {digest}" for one in motions for name, digest in one.hashes.items()),
        "",
        "Checked by (clinician): ______________________   Date: ____________   Signature: ______________________",
        "",
    ]
    return "\n".join(lines) + "\n" + "".join(diffs)
