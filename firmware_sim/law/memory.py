"""What the torque law remembers from tick to tick."""

from __future__ import annotations

from dataclasses import dataclass, fields
from operator import attrgetter

WINDOW_SLOTS = 25
NEVER_TICKS = 1_000  # a half wave so long is none


@dataclass(slots=True)
class Torque:
    """The default is rest. `assist_unm` is the sum of damping and guidance while assisting."""

    assist_unm: int = 0
    gravity_unm: int = 0
    damping_unm: int = 0
    guide_unm: int = 0
    damping_from_unm: int = 0  # both, when the running ramp began
    guide_from_unm: int = 0
    ramp_tick: int = 0
    gravity_from_unm: int = 0
    gravity_tick: int = 500
    gravity_top_unm: int = 0  # the most since there was none
    assist_ticks: int = 0
    authority: int = 1000  # per mille
    impulse: int = 0  # of damping, fading, uN m ms
    work: int = 0  # spent by assist and support, 18 nJ
    # filters, which run in every state; means are scaled by 1024
    slow_mean: int = 0  # the voluntary velocity
    second_mean: int = 0
    fast_mdeg_s: int = 0  # what is above the voluntary velocity
    user_mean: int = 0
    wave_up: bool = False  # the half wave that runs, and the two before it
    wave_ticks: int = NEVER_TICKS
    wave_peak: int = 0
    last_ticks: int = NEVER_TICKS
    last_peak: int = 0
    before_ticks: int = NEVER_TICKS
    before_peak: int = 0
    gain_most: int = 0  # mN m s/rad; what such half waves can be damped with at the rate that torque may rise
    # guidance
    onset_ticks: int = 0
    direction: int = 0
    guide_tick: int = 0  # 0: no guidance runs
    guide_from_mdeg: int = 0
    contact_ticks: int = 0
    fade_ticks: int = 0  # 0: not fading
    peaks: tuple[int, ...] = (0,) * WINDOW_SLOTS
    slot_tick: int = 0

    def __copy__(self) -> Torque:
        """As the default copy, at a fraction of its cost."""
        return Torque(*_memory(self))


_memory = attrgetter(*(field.name for field in fields(Torque)))
