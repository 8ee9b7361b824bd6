"""tests.tools.soak: its shortest form, and what it would not let pass."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from tests.tools.soak import Soaked, report, soak


def test_a_short_soak_runs_to_its_report(tmp_path: Path) -> None:
    """Trips and lateness are of the machine, which has other work here: `make soak` judges them."""
    found = asyncio.run(soak(tmp_path, 4.0, hands=False, every_s=0.2))
    assert found.balanced
    assert len(found.memory_mb) > 3
    assert "ticks late by" in report(found)


@pytest.mark.parametrize(
    ("memory", "trips", "acts", "balanced", "said"),
    [
        ([100.0] * 60 + [200.0 + k / 60 for k in range(120)], 0, 9, True, []),
        ([100.0 + k / 10 for k in range(180)], 0, 9, True, ["memory grew by 11.0 MB"]),
        ([100.0] * 180, 1, 0, False, ["1 trips", "never assisted", "books"]),
    ],
)
def test_what_is_not_well_is_said(memory: list[float], trips: int, acts: int, balanced: bool, said: list[str]) -> None:
    problems = Soaked(tuple(memory), trips, acts, (), (0,) * 8, 0, balanced).problems()
    assert len(problems) == len(said)
    assert all(part in problem for part, problem in zip(said, problems, strict=True))
