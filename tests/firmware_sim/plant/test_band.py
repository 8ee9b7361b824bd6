"""The band of tremor."""

from __future__ import annotations

from math import pi, sin

import numpy as np
import pytest

from firmware_sim.plant.band import filtered, speed_power


def test_power_is_of_the_band_of_tremor() -> None:
    def swing(hertz: float) -> float:
        return speed_power([0.01 / hertz * sin(2 * pi * hertz * ms * 0.001) for ms in range(3_000)])

    assert swing(6.0) > 1e3 * swing(1.0)
    assert swing(6.0) > 1e3 * swing(20.0)


@pytest.mark.parametrize(("hertz", "left"), [(1.0, 0.0), (2.0, 0.0), (3.0, 1.0), (12.0, 1.0), (13.0, 0.0)])
def test_what_is_in_the_band_stays_as_it_is(hertz: float, left: float) -> None:
    swing = np.sin(2.0 * pi * hertz * np.arange(2_000) * 0.001)
    assert filtered(np.stack([swing, 5.0 + swing])) == pytest.approx(np.stack([left * swing] * 2), abs=1e-9)
