"""sensors.cell: the newest value wins and every value is accounted for."""

from __future__ import annotations

import threading

from hypothesis import given
from hypothesis import strategies as st

from hilbridge.sensors.cell import CellCounts, LatestCell


def test_newest_value_wins_and_the_old_one_is_counted() -> None:
    cell: LatestCell[int] = LatestCell()
    cell.put(1)
    cell.put(2)
    assert cell.counts() == CellCounts(received=2, used=0, overwritten=1, failed=0, pending=1)
    assert cell.take() == 2
    assert cell.take() is None
    cell.fail()
    assert cell.counts() == CellCounts(received=3, used=1, overwritten=1, failed=1, pending=0)


def test_closing_counts_what_still_waits_and_what_comes_later() -> None:
    cell: LatestCell[int] = LatestCell()
    cell.put(1)
    cell.close()
    cell.put(2)
    assert cell.wait(60.0) is None
    assert cell.counts() == CellCounts(received=2, used=0, overwritten=2, failed=0, pending=0)


@given(st.lists(st.sampled_from(["put", "take", "fail"])))
def test_the_books_always_balance(steps: list[str]) -> None:
    cell: LatestCell[int] = LatestCell()
    for step in steps:
        {"put": lambda: cell.put(1), "take": cell.take, "fail": cell.fail}[step]()
        assert cell.counts().balanced
    cell.close()
    counts = cell.counts()
    assert counts.received == counts.used + counts.overwritten + counts.failed


def test_a_waiting_reader_gets_every_last_value_across_threads() -> None:
    cell: LatestCell[int] = LatestCell()
    seen: list[int] = []

    def read() -> None:
        while (value := cell.wait(10.0)) is not None:
            seen.append(value)

    reader = threading.Thread(target=read)
    reader.start()
    for value in range(1, 2001):
        cell.put(value)
    while cell.counts().pending:
        pass
    cell.close()
    reader.join(10.0)
    counts = cell.counts()
    assert seen == sorted(seen)
    assert seen[-1] == 2000
    assert counts.received == 2000 == counts.used + counts.overwritten
