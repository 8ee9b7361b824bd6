"""hilscenario.format.durations: what is written is read back."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from hilscenario.format.durations import format_duration, parse_duration_ns


@given(st.integers(0, 10**13))
def test_durations_read_back(value_us: int) -> None:
    assert parse_duration_ns(format_duration(value_us * 1000)) == value_us * 1000
