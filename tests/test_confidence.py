"""hilbridge.confidence: rising maps, one for each condition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.confidence import TREMOR_LEVELS, TREMOR_SHIFT, ConfidenceMaps, RisingMap, condition_of

UNIT = st.floats(0.0, 1.0)


@given(st.lists(st.tuples(UNIT, UNIT), min_size=2, max_size=8), UNIT)
def test_a_map_is_numpys_interpolation_and_rises(knots: list[tuple[float, float]], value: float) -> None:
    x, y = (tuple(sorted(numbers)) for numbers in zip(*knots, strict=True))
    made = RisingMap(x, y)
    assert 0.0 <= made(value) <= 1.0
    assert made(value) <= made(1.0) + 1e-12
    if len(set(x)) == len(x):
        assert made(value) == pytest.approx(float(np.interp(value, x, y)), abs=1e-9)


@pytest.mark.parametrize(
    ("x", "y"),
    [
        ((0.0, 1.0), (0.9, 0.1)),
        ((0.0,), (0.1,)),
        ((0.0, 1.0), (0.0,)),
        ((0.0, 1.0), (0.0, float("nan"))),
        ((0.5, 0.2), (0.0, 1.0)),
        ((0.0, 1.0), (0.0, 1.1)),
    ],
)
def test_impossible_maps_are_refused(x: tuple[float, ...], y: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=r"rise within 0\.\.1"):
        RisingMap(x, y)


def test_each_condition_has_its_own_map_and_none_is_nothing_believed() -> None:
    calm, trembling = RisingMap((0.0, 1.0), (0.0, 0.9)), RisingMap((0.0, 1.0), (0.0, 0.5))
    maps = ConfidenceMaps({condition_of(7): calm, condition_of(7, 2): trembling})
    assert maps.confidence(1.0, 7) == 0.9
    assert maps.confidence(1.0, condition_of(7, 2)) == 0.5
    assert maps.confidence(1.0, 3) == 0.0
    assert maps.confidence(0.4, None) == 0.4


@pytest.mark.parametrize("condition", [0, -1, 8, TREMOR_LEVELS << TREMOR_SHIFT, (TREMOR_LEVELS << TREMOR_SHIFT) + 7])
def test_conditions_that_are_none_are_refused(condition: int) -> None:
    with pytest.raises(ValueError, match="no set of modalities"):
        ConfidenceMaps({condition: RisingMap((0.0, 1.0), (0.0, 1.0))})
