"""The two Kalman filters of the feature chain in closed form: a point that stays, and a point that moves on.

Both axes of a point are alike and independent, so one small covariance serves both and a step is a dozen products of
plain floats. A general filter spends thirty times as long on checking and multiplying 4 x 4 matrices. filterpy's noise and its
`KalmanFilter` are what the tests hold these two against (docs/decisions/011).
"""

from __future__ import annotations

from functools import lru_cache


class ConstantPositionFilter:
    """A constant position: it only wanders. Starts at a measurement, as sure of it as of any."""

    def __init__(self, x: float, y: float, wander_per_s: float, measurement_variance: float) -> None:
        self.x, self.y = x, y
        self.variance = measurement_variance
        self._wander_per_s, self._measurement_variance = wander_per_s, measurement_variance

    def predict(self, elapsed_s: float) -> None:
        """Time passes."""
        self.variance += self._wander_per_s * elapsed_s

    def normalised_innovation_squared(self, x: float, y: float) -> float:
        """Chi-square (two degrees of freedom) of a measurement."""
        return ((x - self.x) ** 2 + (y - self.y) ** 2) / (self.variance + self._measurement_variance)

    def update(self, x: float, y: float) -> None:
        """A measurement."""
        gain = self.variance / (self.variance + self._measurement_variance)
        self.x += gain * (x - self.x)
        self.y += gain * (y - self.y)
        self.variance *= 1.0 - gain


class ConstantVelocityFilter:
    """A constant velocity, pushed by random accelerations. Starts at a measurement, its velocity unknown."""

    def __init__(
        self, x: float, y: float, acceleration_sd: float, measurement_variance: float, velocity_variance: float
    ) -> None:
        self.x, self.y = x, y
        self.vx = self.vy = 0.0
        self._acceleration_variance, self._measurement_variance = acceleration_sd**2, measurement_variance
        # Of either axis: position, position with velocity, velocity.
        self._pp, self._pv, self._vv = measurement_variance, 0.0, velocity_variance

    def predict(self, elapsed_ns: int) -> None:
        """Time passes."""
        dt = elapsed_ns * 1e-9
        pp, pv, vv = process_noise(elapsed_ns, self._acceleration_variance)
        self.x += dt * self.vx
        self.y += dt * self.vy
        self._pp += dt * (2.0 * self._pv + dt * self._vv) + pp
        self._pv += dt * self._vv + pv
        self._vv += vv

    def update(self, x: float, y: float) -> None:
        """A measurement."""
        spread = self._pp + self._measurement_variance
        gain, velocity_gain = self._pp / spread, self._pv / spread
        dx, dy = x - self.x, y - self.y
        self.x += gain * dx
        self.y += gain * dy
        self.vx += velocity_gain * dx
        self.vy += velocity_gain * dy
        self._vv -= velocity_gain * self._pv
        self._pp *= 1.0 - gain
        self._pv *= 1.0 - gain


# Steps are of nearly the same length always: in virtual time of exactly the same.
@lru_cache(maxsize=256)
def process_noise(elapsed_ns: int, acceleration_variance: float) -> tuple[float, float, float]:
    """What a random acceleration adds in a time: variance of position, covariance, variance of velocity."""
    dt = elapsed_ns * 1e-9
    return 0.25 * dt**4 * acceleration_variance, 0.5 * dt**3 * acceleration_variance, dt**2 * acceleration_variance
