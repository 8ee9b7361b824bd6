"""Tremor keeps to its band, wanders, comes and goes as its kind does, and is the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_sim.plant.tremors import KINDS, Recorded, Shaking


def _torque(name: str, seed: int, speed: float, milliseconds: int = 20_000) -> list[float]:
    shaking = Shaking(KINDS[name], seed)
    return [shaking.step(speed)[1] for _ in range(milliseconds)]


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_the_band_holds_nearly_all_of_it(name: str, seed: int) -> None:
    torque, kind = np.array(_torque(name, seed, 1.0)), KINDS[name]
    hertz, power = np.fft.rfftfreq(len(torque), 0.001), np.abs(np.fft.rfft(torque * np.hanning(len(torque)))) ** 2
    within = power[(hertz > kind.low_hz - 0.7) & (hertz < kind.high_hz + 0.7)].sum()
    assert within > 0.97 * power.sum()


def test_parkinsonian_fades_with_movement_and_cerebellar_grows() -> None:
    for name, louder in (("parkinsonian", 0.0), ("cerebellar", 1.0)):
        loud, quiet = (np.std(_torque(name, 3, speed)) for speed in (louder, 1.0 - louder))
        assert loud > 3.0 * quiet


def test_the_same_seed_shakes_the_same_and_another_does_not() -> None:
    assert _torque("essential", 1, 0.0, 100) == _torque("essential", 1, 0.0, 100) != _torque("essential", 2, 0.0, 100)


def test_a_recorded_tremor_begins_again() -> None:
    tremor = Recorded((1.0, 2.0))
    assert [tremor.step(0.0)[1] for _ in range(3)] == [1.0, 2.0, 1.0]
