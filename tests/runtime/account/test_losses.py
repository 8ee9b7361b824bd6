"""Frames lost have one meaning: sent and never received."""

from __future__ import annotations

from hilbridge.runtime.account.losses import Losses


def test_nothing_is_lost_before_it_is_known_what_was_withdrawn() -> None:
    losses = Losses()
    assert losses.lost(79) == 0
    losses.on_withdrawn(79, 20)
    assert losses.lost(79) == 0
    assert losses.before(79) == 79


def test_gaps_after_that_are_lost_frames_less_those_withdrawn() -> None:
    losses = Losses()
    losses.on_withdrawn(79, 79)
    losses.on_withdrawn(79, 79)
    assert losses.lost(82) == 3
    losses.on_withdrawn(94, 94)
    assert losses.lost(94) == 0
    assert losses.lost(97, withdrawn=95) == 2


def test_a_device_that_starts_anew_is_counted_anew() -> None:
    losses = Losses()
    losses.on_withdrawn(50, 50)
    losses.on_withdrawn(50, 50)
    losses.on_withdrawn(0, 60)
    assert losses.lost(61) == 0
    losses.on_withdrawn(0, 60)
    assert losses.lost(61) == 1
