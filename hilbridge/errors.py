"""The one kind of error that is the user's to mend: its text is one line that names the thing and the cure."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager


class InputError(ValueError):
    """Something given from outside cannot be used. The command line prints the text and exits with 2."""


@contextmanager
def needs_extra(extra: str) -> Iterator[None]:
    """Imports inside may fail where an optional dependency is absent. Raises InputError naming the package and the extra.

    A module of the project that is missing is a defect, not an absent extra, and is raised as it is.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package in ("", "hilbridge", "hilscenario"):
            raise
        raise InputError(f"{package} is not installed; add it with `pip install 'hilbridge[{extra}]'`") from None


def nearest(name: str, known: Iterable[str]) -> str:
    """`did you mean X?`, or what there is: the end of a sentence that refuses a name."""
    by_plain = {_plain(one): one for one in known}
    near = difflib.get_close_matches(_plain(name), by_plain, n=1)
    return f"did you mean `{by_plain[near[0]]}`?" if near else f"known: {', '.join(sorted(by_plain.values()))}"


def _plain(name: str) -> str:
    """Without what is often written otherwise: case and underscores."""
    return name.lower().replace("_", "")
