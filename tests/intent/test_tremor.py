import math

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import STEP_NS
from hilbridge.intent.tremor import SECTIONS, BandPass, SlidingMedian, TremorGuard
from hilbridge.records import Hand, HandTracks
from hilbridge.wearer.person import Wearer
from hilbridge.wearer.shaking import Tremor


def flags(seed, seconds, tremor=None):
    wearer = Wearer(seed, tremor=tremor, width_px=96, height_px=72)
    assembler, guard = FeatureAssembler(), TremorGuard()
    made = []
    for step in range(round(seconds * 25)):
        t = step * STEP_NS
        made.append(guard.update(assembler.update(None, None, wearer.hands(t), t)))
    return np.array(made)


def test_the_written_out_filter_is_the_one_it_says():
    expected = butter(2, [3.0, 11.5], btype="band", fs=25, output="sos")
    assert np.allclose(SECTIONS, expected)
    x = np.random.default_rng(0).normal(size=200)
    band = BandPass()
    assert np.allclose([band.step(number) for number in x.tolist()], sosfilt(expected, x))


def test_the_sliding_median_is_numpys():
    rng = np.random.default_rng(1)
    numbers = np.concatenate([np.zeros(32), rng.choice([0.0, 0.5, 1.0], size=100), rng.normal(size=200)])
    sliding = SlidingMedian(32)
    for end in range(33, len(numbers) + 1):
        sliding.add(float(numbers[end - 1]))
        assert sliding.median == np.median(numbers[end - 32 : end])


@pytest.mark.parametrize("hz", [3.0, 4.0, 5.0, 6.0, 8.0, 10.0])
def test_tremor_is_seen_within_two_seconds_and_stays_seen(hz):
    for seed in (21, 22):
        assert flags(seed, 12, Tremor(hz))[50:].mean() > 0.97


def test_calm_reaching_is_not_tremor():
    calm = np.concatenate([flags(seed, 30) for seed in range(23, 28)])
    assert calm.mean() < 0.06


def test_it_ends_with_the_tremor():
    assembler, guard = FeatureAssembler(), TremorGuard()
    shaking, calm = Wearer(29, tremor=Tremor(6.0)), Wearer(29)
    seen = []
    for step in range(250):
        t = step * STEP_NS
        hands = (shaking if step < 125 else calm).hands(t)
        seen.append(guard.update(assembler.update(None, None, hands, t)))
    assert all(seen[60:125])
    assert not any(seen[165:])


def test_thresholds_out_of_order_are_refused():
    with pytest.raises(ValueError, match="need 0 < off <= on"):
        TremorGuard(0.001, 0.002)


@pytest.mark.parametrize(("amplitude", "level"), [(0.0, 0), (0.012, 1), (0.022, 2), (0.06, 3)])
def test_a_stronger_tremor_is_a_higher_level(amplitude: float, level: int) -> None:
    guard, assembler = TremorGuard(), FeatureAssembler()
    for step in range(100):
        t = step * STEP_NS
        swing = amplitude * math.sin(2.0 * math.pi * 5.3 * t * 1e-9)
        hands = HandTracks(t, (Hand(0.3 + swing, 0.8, 0.9), Hand(0.7 + swing, 0.8, 0.9)))
        guard.update(assembler.update(None, None, hands, t))
    assert guard.level == level
    assert guard.trembling == (level > 0)
