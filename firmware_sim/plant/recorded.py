"""A tremor that was recorded, as elbow torque: acceleration of the hand from 3 to 12 Hz along its main direction.

Its torque is that of the forearm's inertia, swung at the hand's distance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_sim.plant.band import filtered
from firmware_sim.plant.chain import wearers_arm
from firmware_sim.plant.parameters import value

_STEP_S = 0.001
Array = NDArray[np.float64]


def torque_of(t_s: Array, acceleration: Array) -> tuple[float, ...]:
    """N m at the elbow, 1000 a second, from m/s2 (N, 3) at rising times."""
    even = np.arange(t_s[0], t_s[-1], _STEP_S)
    evenly = np.stack([np.interp(even, t_s, axis) for axis in acceleration.T])
    shakes = filtered(evenly)
    _, directions = np.linalg.eigh(shakes @ shakes.T)
    arm = wearers_arm()
    return tuple((directions[:, -1] @ shakes * (arm.about_elbow / value("hand"))).tolist())


def strongest(torque_nm: tuple[float, ...], count: int) -> tuple[float, ...]:
    """The `count` milliseconds that shake most; all of a shorter one."""
    if len(torque_nm) <= count:
        return torque_nm
    sums = np.concatenate([[0.0], np.cumsum(np.square(torque_nm))])
    start = int(np.argmax(sums[count:] - sums[:-count]))
    return torque_nm[start : start + count]
