"""What a part of `make safety` reports, and how much of it is run."""

from __future__ import annotations

from dataclasses import dataclass

# For what changes or measures the reference: the C beside it would show nothing of it.
REFERENCE = {"HILBRIDGE_TESTED": "python", "HILBRIDGE_CONTROLLER": "python"}


@dataclass(frozen=True, slots=True)
class Row:
    """One claim of the safety contract, the figure found, and whether it holds."""

    part: str
    claim: str
    figure: str
    holds: bool


@dataclass(frozen=True, slots=True)
class Scale:
    """How much is run. `quick` is the seeded part of `make test`; `share` scales the random campaigns of the full run.

    `files` are those to mutate; none given: all.
    """

    quick: bool = False
    seed: int = 20260101
    share: float = 1.0
    bus: str = "auto"
    files: tuple[str, ...] = ()

    def of(self, full: int, quick: int) -> int:
        """So many cases of a random campaign; what is exhaustive is never scaled."""
        return quick if self.quick else max(quick, round(full * self.share))


def printed(rows: list[Row]) -> str:
    """The table, one line a claim."""
    width = max(len(row.part) for row in rows)
    claim = max(len(row.claim) for row in rows)
    lines = [f"{'part':<{width}}  {'claim':<{claim}}  found"]
    for row in rows:
        lines.append(f"{row.part:<{width}}  {row.claim:<{claim}}  {row.figure}{'' if row.holds else '   <-- FAILS'}")
    return "\n".join(lines)
