import numpy as np
import pytest
from scipy import stats

from hilbridge.wearer.noise import Noise

STEP_NS = 40_000_000


def test_it_is_a_pure_function_of_person_stream_and_time():
    noise = Noise(5, 3)
    forward = [noise.normals(t, 3) for t in range(0, 10 * STEP_NS, STEP_NS)]
    backward = [Noise(5, 3).normals(t, 3) for t in range(0, 10 * STEP_NS, STEP_NS)[::-1]]
    assert forward == backward[::-1]
    assert forward[0][:2] == noise.normals(0, 1)
    for other in (Noise(6, 3), Noise(5, 6)):
        assert other.normals(STEP_NS, 3) != forward[1]


@pytest.mark.parametrize("step_ns", [1, 1_000_000, STEP_NS, 2**40])
def test_moments_near_and_far_are_independent_standard_normals(step_ns: int):
    noise = Noise(1, 3)
    drawn = np.array([noise.normals(k * step_ns, 3) for k in range(20_000)])
    for column in drawn.T:
        assert stats.kstest(column, "norm").pvalue > 1e-4
    assert np.abs(np.corrcoef(drawn.T) - np.eye(6)).max() < 0.04
    following = [np.corrcoef(drawn[:-1, column], drawn[1:, other])[0, 1] for column in range(6) for other in range(6)]
    assert np.abs(following).max() < 0.04
    # Nor are the sizes: pairs that share a radius must not show.
    assert np.abs(np.corrcoef(np.square(drawn).T) - np.eye(6)).max() < 0.04


def test_people_are_independent():
    drawn = np.array(
        [[value for t in range(2_000) for value in Noise(seed, 6).normals(t * STEP_NS, 1)] for seed in range(8)]
    )
    assert np.abs(np.corrcoef(drawn) - np.eye(8)).max() < 0.07
