"""Tremor estimators side by side: `python -m tests.tools.arm.tremor_estimators`.

Each is fed an elbow's movement, 100 samples a second: a reach every 4 s and a tremor that wanders, or none. `bmflc` is the
band-limited multiple Fourier linear combiner (2 to 10 Hz in steps of 0.1 Hz, LMS), `kalman` its Kalman form, `split` what
the torque law has today: velocity less its 2 Hz low pass. Told for each: frequency error, delay and gain of the tremor, and
what an arm that only reaches is made to shake.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_sim.plant.tremors import KINDS, Shaking
from hilscenario.twins.reaching import REST, Leg, Reaches

Array = NDArray[np.float64]
SECONDS = 24
RATE = 1_000
THINNED = 10  # the combiners run at 100 Hz, as the published ones do
LMS_GAIN = 0.01
HERTZ = np.arange(2.0, 10.05, 0.1)
SETTLED = 4 * RATE
SPEED_RAD_S = 0.6  # of the tremor


def _basis(samples: int) -> Array:
    angle = 2.0 * np.pi * HERTZ[None, :] * (np.arange(samples)[:, None] * THINNED / RATE)
    return np.concatenate([np.sin(angle), np.cos(angle)], axis=1)


@dataclass(frozen=True)
class Estimate:
    """Tremor and its frequency, both at the combiner's rate."""

    wave: Array
    hertz: Array


def bmflc(speed: Array) -> Estimate:
    """LMS."""
    basis, weights = _basis(len(speed)), np.zeros(2 * len(HERTZ))
    wave, hertz = np.zeros(len(speed)), np.zeros(len(speed))
    for n, row in enumerate(basis):
        wave[n] = row @ weights
        weights += 2.0 * LMS_GAIN * (speed[n] - wave[n]) * row
        hertz[n] = _centre(weights)
    return Estimate(wave, hertz)


def kalman(speed: Array, drift: float = 1e-4, noise: float = 5.0) -> Estimate:
    """Weights as a random walk."""
    size = 2 * len(HERTZ)
    basis, weights, spread = _basis(len(speed)), np.zeros(size), np.eye(size) * 0.01
    wave, hertz = np.zeros(len(speed)), np.zeros(len(speed))
    for n, row in enumerate(basis):
        spread[np.diag_indices(size)] += drift
        seen = spread @ row
        gain = seen / (row @ seen + noise)
        wave[n] = row @ weights
        weights = weights + gain * (speed[n] - wave[n])
        spread -= np.outer(gain, seen)
        hertz[n] = _centre(weights)
    return Estimate(wave, hertz)


def split(speed: Array) -> Estimate:
    """Today's law: velocity less its first-order low pass of 2 Hz; frequency from its last whole wave."""
    keeps, slow, last = 2.0 * np.pi * 2.0 * THINNED / RATE, 0.0, 0.0
    wave, hertz, rose, now = np.zeros(len(speed)), np.zeros(len(speed)), 0, 0.0
    for n, value in enumerate(speed):
        slow += keeps / (1.0 + keeps) * (value - slow)
        wave[n] = value - slow
        if last <= 0.0 < wave[n]:
            now, rose = RATE / THINNED / max(1, n - rose), n
        last, hertz[n] = wave[n], now
    return Estimate(wave, hertz)


def _centre(weights: Array) -> float:
    power = weights[: len(HERTZ)] ** 2 + weights[len(HERTZ) :] ** 2
    total = float(power.sum())
    return float(power @ HERTZ) / total if total > 0.0 else 0.0


ESTIMATORS: dict[str, Callable[[Array], Estimate]] = {"bmflc": bmflc, "kalman": kalman, "split": split}


def reaching() -> Array:
    """Speed of an elbow that reaches out and back every 4 s, 100 a second."""
    plan = Reaches(
        [Leg(at + part, to) for at in range(1, SECONDS, 4) for part, to in ((0.0, (0.55, 1.4)), (2.0, REST))]
    )
    return np.array([plan(n * THINNED / RATE)[1][1] for n in range(SECONDS * RATE // THINNED)])


def trembling(kind: str, seed: int) -> tuple[Array, Array]:
    """(speed, frequency) of a tremor alone, 100 a second."""
    shaking = Shaking(KINDS[kind], seed)
    wave = np.array([shaking.step(1.0)[1] for _ in range(SECONDS * RATE)])
    spectrum, hertz = np.fft.fft(wave), np.fft.fftfreq(len(wave), 1.0 / RATE)
    turned = np.fft.ifft(spectrum * (hertz > 0.0) * 2.0)  # the analytic signal
    hertz_now = np.gradient(np.unwrap(np.angle(turned))) * RATE / (2.0 * np.pi)
    smooth = np.convolve(hertz_now, np.ones(250) / 250, mode="same")
    scale = SPEED_RAD_S / float(np.std(wave)) / np.sqrt(2.0)
    return (wave * scale)[::THINNED], smooth[::THINNED]


def judged(name: str, kind: str, seed: int) -> tuple[float, float, float, float]:
    """(Hz RMS error, ms delay, gain, tremor found where there is none, as a share of the true one's RMS)."""
    estimator = ESTIMATORS[name]
    tremor, hertz = trembling(kind, seed)
    voluntary = reaching()
    if name != "split":  # the combiners are made for acceleration
        tremor, voluntary = (np.gradient(one) * RATE / THINNED for one in (tremor, voluntary))
    found, none = estimator(tremor + voluntary), estimator(voluntary)
    from_n = SETTLED // THINNED
    truth, wave = tremor[from_n:], found.wave[from_n:]
    lags = range(-10, 11)
    fits = [float(np.dot(truth[10:-10], wave[10 + lag : len(wave) - 10 + lag])) for lag in lags]
    best = lags[int(np.argmax(fits))]
    gain = max(fits) / float(np.dot(truth[10:-10], truth[10:-10]))
    error = float(np.sqrt(np.mean((found.hertz[from_n:] - hertz[from_n:]) ** 2)))
    false = float(np.sqrt(np.mean(none.wave[from_n:] ** 2) / np.mean(truth**2)))
    return error, best * 1_000.0 * THINNED / RATE, gain, false


if __name__ == "__main__":
    for kind in KINDS:
        for name in ESTIMATORS:
            rows = np.array([judged(name, kind, seed) for seed in range(5)])
            error, delay, gain, false = rows.mean(axis=0)
            print(f"{kind} {name}: {error:.2f} Hz, {delay:+.0f} ms, gain {gain:.2f}, false tremor {100 * false:.0f} %")
