"""runtime.account.stages: percentiles to 2 % however many times there are, and nothing lost."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.runtime.account.stages import Histogram, Stages

TIMES = st.lists(st.integers(0, 10**10), min_size=1, max_size=300)


@given(TIMES)
def test_percentiles_are_those_of_the_numbers(times_ns: list[int]) -> None:
    histogram = Histogram()
    for one in times_ns:
        histogram.add(one)
    for share in (0.5, 0.99):
        exact_ms = float(np.percentile(times_ns, 100 * share, method="inverted_cdf")) / 1e6
        assert histogram.percentile_ms(share) == pytest.approx(exact_ms, rel=0.025, abs=0.0011)
    assert histogram.max_ns == max(times_ns)
    assert histogram.count == len(times_ns) == sum(histogram.shares((0.5, 1.0, 5.0)))


def test_shares_are_counted_between_the_edges() -> None:
    histogram = Histogram()
    for one_ms in (0.1, 0.2, 0.7, 3.0, 30.0, 31.0, 32.0):
        histogram.add(round(one_ms * 1e6))
    assert histogram.shares((0.5, 1.0, 5.0)) == [2, 1, 1, 3]
    assert Histogram().percentile_ms(0.5) == 0.0


def test_stages_stand_in_the_order_in_which_they_came() -> None:
    stages = Stages()
    stages.add("tick", 2_000_000)
    stages.add("hands", 1_000_000)
    stages.add("tick", 4_000_000)
    assert [(one.name, one.count, one.max_ms) for one in stages.table()] == [("tick", 2, 4.0), ("hands", 1, 1.0)]
    assert stages.of("none") is None
