"""That a row which says C steps the C: otherwise everything beside would prove nothing of it."""

from __future__ import annotations

from firmware_sim import controllers
from firmware_sim.c import binding
from firmware_sim.controller import advance
from tests.safety.hand import Hand


def test_a_row_steps_the_controller_that_it_names(controller: str) -> None:
    stepped = controllers.step_of(Hand().state)
    assert stepped is (advance if controller == "python" else binding.advance_in_c)
