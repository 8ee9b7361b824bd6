"""filterpy's general filter and scipy's Hungarian method are what the closed forms are held against."""

import numpy as np
import pytest
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from hilbridge.features.hands import nearest
from hilbridge.features.kalman import ConstantPositionFilter, ConstantVelocityFilter, process_noise

SEEDS = range(20)


def steps(rng: np.random.Generator) -> list[tuple[int, tuple[float, float] | None]]:
    """Elapsed ns, as uneven as cameras are, and what is measured then; every fifth is missed."""
    return [
        (int(rng.integers(0, 120_000_000)), None if rng.uniform() < 0.2 else (rng.uniform(), rng.uniform()))
        for _ in range(200)
    ]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_still_point_is_filterpys(seed: int):
    rng = np.random.default_rng(seed)
    ours = ConstantPositionFilter(0.4, 0.6, wander_per_s=800.0, measurement_variance=60.0)
    oracle = KalmanFilter(dim_x=2, dim_z=2)
    oracle.x = np.array([[0.4], [0.6]])
    oracle.F = oracle.H = np.eye(2)
    oracle.P = oracle.R = np.eye(2) * 60.0
    for elapsed_ns, measured in steps(rng):
        ours.predict(elapsed_ns * 1e-9)
        oracle.predict(Q=np.eye(2) * 800.0 * elapsed_ns * 1e-9)
        if measured is not None:
            innovation = np.array(measured) * 1000.0 - oracle.x[:, 0]
            chi2 = innovation @ np.linalg.solve(oracle.P + oracle.R, innovation)
            assert ours.normalised_innovation_squared(measured[0] * 1000.0, measured[1] * 1000.0) == pytest.approx(
                chi2, rel=1e-9
            )
            ours.update(measured[0] * 1000.0, measured[1] * 1000.0)
            oracle.update(np.array(measured)[:, None] * 1000.0)
        assert (ours.x, ours.y) == pytest.approx(tuple(oracle.x[:, 0]), rel=1e-9)
        assert ours.variance == pytest.approx(oracle.P[0, 0], rel=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_moving_point_is_filterpys(seed: int):
    rng = np.random.default_rng(seed)
    ours = ConstantVelocityFilter(0.4, 0.6, acceleration_sd=3.0, measurement_variance=0.012**2, velocity_variance=0.5)
    # Built by hand: filterpy's `kinematic_kf(2, 1)` observes x + y.
    oracle = KalmanFilter(dim_x=4, dim_z=2)
    oracle.x = np.array([[0.4], [0.0], [0.6], [0.0]])
    oracle.H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    oracle.P = np.diag([0.012**2, 0.5, 0.012**2, 0.5])
    oracle.R = np.eye(2) * 0.012**2
    for elapsed_ns, measured in steps(rng):
        dt = elapsed_ns * 1e-9
        noise = 9.0 * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
        ours.predict(elapsed_ns)
        oracle.predict(F=np.kron(np.eye(2), [[1.0, dt], [0.0, 1.0]]), Q=np.kron(np.eye(2), noise))
        if measured is not None:
            ours.update(*measured)
            oracle.update(np.array(measured)[:, None])
        state = (ours.x, ours.vx, ours.y, ours.vy)
        assert state == pytest.approx(tuple(oracle.x[:, 0]), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("rows", [0, 1, 2])
@pytest.mark.parametrize("columns", [0, 1, 2, 3, 5])
def test_the_nearest_pairs_are_the_hungarian_methods(rows: int, columns: int):
    rng = np.random.default_rng(10 * rows + columns)
    for _ in range(100):
        distance = rng.uniform(size=(rows, columns))
        expected = set(zip(*(index.tolist() for index in linear_sum_assignment(distance)), strict=True))
        assert set(nearest(distance.tolist())) == expected


def test_of_two_equal_ways_the_first_is_taken():
    assert nearest([[0.5, 0.5], [0.5, 0.5]]) == ((0, 0), (1, 1))
    assert nearest([[0.5], [0.5]]) == ((0, 0),)


@given(st.integers(1, 10**9), st.floats(1e-6, 1e4))
def test_the_noise_is_filterpys_to_the_last_bit(elapsed_ns: int, variance: float):
    (pp, pv), (_, vv) = Q_discrete_white_noise(2, elapsed_ns * 1e-9, variance).tolist()
    assert process_noise(elapsed_ns, variance) == (pp, pv, vv)
