"""wearer.shaking: a plain tremor is a sine; a real one wanders, shakes head and gaze, hides hands, overshoots."""

from __future__ import annotations

import numpy as np

from hilbridge.limits import MS
from hilbridge.wearer.person import Wearer
from hilbridge.wearer.shaking import Shaking, Tremor, realistic, tremor_of

TIMES = [40 * MS * step for step in range(1_500)]


def test_without_tremor_nothing_shakes() -> None:
    calm = Shaking(None, 5)
    for t_ns in TIMES[:50]:
        assert calm.hands(t_ns) == ((0.0, 0.0), (0.0, 0.0))
        assert (calm.arm_deg(t_ns), calm.head(t_ns), calm.gaze(t_ns)) == (0.0, (0.0, 0.0), (0.0, 0.0))
        assert not calm.loses(0, t_ns)
        assert calm.overshoot(t_ns) == 0.0


def test_a_plain_tremor_is_a_clean_sine_of_its_amplitude() -> None:
    swing = np.array([Shaking(Tremor(5.0, 0.02), 5).hands(t_ns)[0][0] for t_ns in TIMES])
    assert 0.019 <= swing.max() <= 0.02 + 1e-9
    assert abs(swing.mean()) < 1e-3


def test_a_real_tremor_wanders_in_amplitude_and_frequency() -> None:
    shaking = Shaking(realistic(5.0), 5)
    swing = np.array([shaking.hands(8 * MS * step)[0][0] for step in range(7_500)])
    parts = np.array([part.std() for part in np.split(swing, 60)])
    assert parts.max() > 2.0 * parts.min()
    crossings = [int((np.diff(np.sign(part)) != 0).sum()) for part in np.split(swing, 30)]
    assert max(crossings) > min(crossings)


def test_hands_are_lost_for_a_while_and_the_same_moment_always_says_the_same() -> None:
    shaking = Shaking(realistic(5.0), 5)
    lost = np.array([shaking.loses(1, t_ns) for t_ns in TIMES])
    assert 0.08 <= lost.mean() <= 0.3
    assert [shaking.loses(1, t_ns) for t_ns in reversed(TIMES)] == lost[::-1].tolist()


def test_a_reach_overshoots_and_settles() -> None:
    shaking = Shaking(realistic(5.0), 5)
    excess = [shaking.overshoot(20 * MS * step) for step in range(200)]
    assert max(excess) > 0.05
    assert min(excess) < 0.0
    assert excess[-1] == 0.0


def test_people_tremble_each_in_their_own_way_and_gaze_and_picture_shake_too() -> None:
    assert len({tremor_of(seed) for seed in range(20)}) == 20
    assert all(3.0 <= tremor_of(seed).hz <= 8.0 for seed in range(50))
    calm, shaky = Wearer(3), Wearer(3, tremor=realistic(5.0, 0.03))
    moved = [calm.gaze(t_ns).x != shaky.gaze(t_ns).x for t_ns in TIMES[:100]]
    assert sum(moved) > 90
    assert any((calm.frame(t_ns).pixels != shaky.frame(t_ns).pixels).any() for t_ns in TIMES[:5])
