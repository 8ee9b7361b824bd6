"""What "right" means, in one place: for calibration, replays, certificates, bounds, figures and recordings alike.

A verb is right at a tick when it is under way, or when it is coming: the wearer prepares it. Where preparation is not
labelled, a verb is coming from `COMING_NS` before it begins. While the wearer is idle no verb is right. Pure.
"""

from __future__ import annotations

from hilbridge.limits import MS

COMING_NS = 1_000 * MS


def coming(following: int | None, until_onset_ns: int | None) -> int | None:
    """The verb that counts as prepared where nobody labelled preparation; `until_onset_ns` is the time until it begins."""
    if following is None or until_onset_ns is None:
        return None
    return following if 0 <= until_onset_ns <= COMING_NS else None


def is_right(verb_index: int, under_way: int | None, prepared: int | None) -> bool:
    """Whether assisting `verb_index` is what the wearer wants now; None: nothing is under way, or prepared."""
    return verb_index in (under_way, prepared)
