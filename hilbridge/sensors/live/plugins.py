"""Sensors of others: `package.module:Name`, or the name under which an installed package offers one (entry points)."""

from __future__ import annotations

import importlib
import re
import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, NamedTuple

from hilbridge.errors import InputError, nearest

GAZE = "hilbridge.gaze"  # group of entry points: a class that is called with what stands after its name
_OWN = re.compile(r"(?P<module>[A-Za-z_]\w*(\.[A-Za-z_]\w*)*):(?P<name>[A-Za-z_]\w*)(:(?P<argument>.*))?")


class Own(NamedTuple):
    """Something of somebody else's, found but not called, and what it is to be called with."""

    made_by: Any
    argument: str


def offered(group: str = GAZE) -> dict[str, EntryPoint]:
    """Name -> what an installed package offers under it."""
    return {point.name: point for point in entry_points(group=group)}


def is_own(spec: str) -> bool:
    """Whether it names code: a class (`package:Class`), or what a package offers. A file of that name goes first."""
    found = _OWN.fullmatch(spec)
    return not Path(spec).exists() and (
        (found is not None and found["name"][:1].isupper()) or spec.partition(":")[0] in offered()
    )


def own(key: str, spec: str) -> Own:
    """What a spec names. A module beside the working folder's files may be named, too. Raises InputError."""
    name, _, argument = spec.partition(":")
    try:
        if name in offered():
            return Own(offered()[name].load(), argument)
        found = _OWN.fullmatch(spec)
        if found is None:
            raise InputError(f"{key} {spec}: names no code; write package.module:Name")
        if "" not in sys.path:
            sys.path.append("")  # last: a file there must not stand in for a module of anybody else's
        module = importlib.import_module(found["module"])
    except ImportError as error:
        raise InputError(f"{key} {spec}: cannot be imported ({error}); install it, or start where it lies") from None
    if not hasattr(module, found["name"]):
        raise InputError(
            f"{key} {spec}: {found['module']} has no {found['name']}; {nearest(found['name'], vars(module))}"
        )
    return Own(getattr(module, found["name"]), found["argument"] or "")


def called(key: str, spec: str, base: type[Any] | tuple[type[Any], ...] | None = None) -> Any:
    """What it makes. Raises InputError where that fails, or is no `base`."""
    thing = own(key, spec)
    try:
        made = thing.made_by(*([thing.argument] if thing.argument else []))
    except InputError:
        raise
    except Exception as error:  # code of others may raise anything
        raise InputError(f"{key} {spec}: {type(error).__name__}: {error}") from None
    if base is not None and not isinstance(made, base):
        names = " or ".join(one.__name__ for one in (base if isinstance(base, tuple) else (base,)))
        raise InputError(f"{key} {spec}: makes a {type(made).__name__}, not a {names} (docs/api.md)")
    return made
