"""Filters of the torque law. They run in every state and know no profile, so that no assist starts from stale memory.

Velocity is split at 2 Hz: the slow part is the voluntary movement, the rest is `fast_mdeg_s`. A second stage of the same
corner cuts the rest into half waves. Tremor is what swings both ways in short half waves; a reach, a drop or a rhythm of
the wearer's own makes long ones.
"""

from __future__ import annotations

from firmware_sim.law.memory import NEVER_TICKS, Torque

_SPLIT = 13  # / 1024 per ms: 2 Hz
_USER = 4  # 0.6 Hz: tremor of 2 N m at 3 Hz leaves 0.4 N m
WINDOW_SLOT_MS = 10
_GAIN = 215_000  # half waves are damped at no more than rises by 12 N m/s, hardly more than torque may
_FORGETS = 9  # the impulse fades with a time constant of 512 ms


def track(torque: Torque, velocity_mdeg_s: int, user_unm: int) -> None:
    """One tick of every filter, and of the 250 ms window."""
    fast = velocity_mdeg_s - (torque.slow_mean >> 10)
    torque.slow_mean += _SPLIT * fast
    torque.fast_mdeg_s = fast
    wave = fast - (torque.second_mean >> 10)
    torque.second_mean += _SPLIT * wave
    torque.user_mean += _USER * (user_unm - (torque.user_mean >> 10))
    torque.impulse += torque.damping_unm - (torque.impulse >> _FORGETS)
    up = wave > 0
    size = abs(fast)
    if up is not torque.wave_up:
        torque.before_ticks, torque.before_peak = torque.last_ticks, torque.last_peak
        torque.last_ticks, torque.last_peak = torque.wave_ticks, torque.wave_peak
        torque.wave_up, torque.wave_ticks, torque.wave_peak = up, 1, size
        torque.gain_most = torque.last_ticks * _GAIN // max(torque.last_peak, 1)
    else:
        if size > torque.wave_peak:
            torque.wave_peak = size
        if torque.wave_ticks < NEVER_TICKS:
            torque.wave_ticks += 1
    torque.slot_tick += 1
    if torque.slot_tick >= WINDOW_SLOT_MS:
        torque.slot_tick = 0
        torque.peaks = (*torque.peaks[1:], abs(torque.assist_unm))
