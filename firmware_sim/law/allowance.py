"""How much an ACT may still do: authority, which falls as the wearer opposes, and the work it may spend.

Both are of everything an ACT adds, assist and gravity support alike.
"""

from __future__ import annotations

from firmware_sim.law.memory import Torque

OPPOSE_FROM_UNM = 500_000
OPPOSE_TO_UNM = 1_500_000
AUTHORITY_RISE_PER_MS = 2
PUSH_SHIFT = 14  # a push below 16 mN m is opposed in part, so that nothing jumps where it changes sign
WORK = 4_369_000  # 80 mJ in units of 2^20 uN m mdeg/s ms
WORK_FADE = 2_730_000  # the last 50 mJ fade
WORK_BACK_PER_MS = 437  # all of it in ten seconds without assist


def opposed(torque: Torque) -> None:
    """Falls as the wearer's slow torque goes against what pushes, comes back slowly. Tremor is no opposition."""
    push = torque.gravity_unm + torque.guide_unm
    user = torque.user_mean >> 10
    opposing = 0
    if user * push < 0:
        opposing = abs(user) * min(abs(push), 1 << PUSH_SHIFT) >> PUSH_SHIFT
    if opposing <= OPPOSE_FROM_UNM:
        allowed = 1000
    elif opposing >= OPPOSE_TO_UNM:
        allowed = 0
    else:
        allowed = (OPPOSE_TO_UNM - opposing) * 1000 // (OPPOSE_TO_UNM - OPPOSE_FROM_UNM)
    torque.authority = min(allowed, torque.authority + AUTHORITY_RISE_PER_MS)


def work_left(torque: Torque) -> int:
    """Share of the push that the work still allows, per mille: all of it until the last part, then less and less."""
    return max(0, min(WORK - torque.work, WORK_FADE)) * 1000 // WORK_FADE


def spend(torque: Torque, velocity_mdeg_s: int) -> None:
    """Count what this tick gives to the arm, each part by itself: what one takes back does not pay for the other."""
    guide, gravity = torque.guide_unm * velocity_mdeg_s, torque.gravity_unm * velocity_mdeg_s
    if guide > 0:
        torque.work += guide >> 20
    if gravity > 0:
        torque.work += gravity >> 20


def recover(torque: Torque) -> None:
    """A tick without assist."""
    torque.work = max(0, torque.work - WORK_BACK_PER_MS)
