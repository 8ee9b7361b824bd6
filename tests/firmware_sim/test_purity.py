"""The controller is a pure function of (state, inputs, time), in integers: what a mechanical port to C needs."""

from __future__ import annotations

import ast
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import pytest

import firmware_sim
from firmware_sim import frames
from firmware_sim.controller import advance
from firmware_sim.memory import Inputs, Received
from firmware_sim.states import State
from tests.safety.hand import Hand
from tests.safety.stepping import copied, step

HOME = Path(firmware_sim.__file__).parent
STEP = (
    "controller", "receive", "transitions", "watchdogs", "torque", "transmit", "states", "memory", "profiles",
    "assist_profile", "frames", "e2e", "secoc", "selftest", "law.allowance", "law.damping", "law.filters", "law.guidance",
    "law.memory", "law.numbers", "law.support",
)  # fmt: skip
# When a state is made, never in a step: the C has the same table compiled in.
READ_ONCE = ("profiles", "profile_file")
# Nothing that reads a clock, a bus, a file or chance; `cryptography` is AES in secoc alone.
ALLOWED = {"__future__", "collections", "copy", "dataclasses", "enum", "functools", "itertools", "operator", "typing"}


PACKAGES = ("firmware_sim", "firmware_sim.law")


def source(name: str) -> str:
    return (HOME / f"{name.replace('.', '/')}.py").read_text()


def imported(name: str) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(source(name))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            found |= {f"{module}.{alias.name}" for alias in node.names} if module in PACKAGES else {module}
    return found


@pytest.mark.parametrize("name", STEP)
def test_what_the_step_is_made_of_has_no_clock_no_bus_and_no_chance(name: str) -> None:
    for module in imported(name):
        ours = module.removeprefix("firmware_sim.") if module.startswith("firmware_sim") else None
        if (name, ours) == READ_ONCE:
            continue
        if ours is not None:
            assert ours in STEP, module
        elif module.split(".")[0] == "cryptography":
            assert name == "secoc"
        else:
            assert module.split(".")[0] in ALLOWED, module


@pytest.mark.parametrize("name", STEP)
def test_the_step_calculates_in_integers(name: str) -> None:
    for node in ast.walk(ast.parse(source(name))):
        assert not isinstance(node, ast.Div), f"{name}: a division that is not of integers"
        assert not (isinstance(node, ast.Constant) and isinstance(node.value, float)), f"{name}:{node.lineno}"


def test_a_step_leaves_its_state_untouched_and_gives_the_same_twice() -> None:
    hand = Hand().to_assist()
    before, kept = hand.state, deepcopy(hand.state)
    inputs = replace(hand.inputs, frames=(*hand.act(), hand.heartbeat()))
    first, second = step(before, inputs, hand.now_ms + 1), step(before, inputs, hand.now_ms + 1)
    assert before == kept
    assert before.torque is not first[0].torque
    assert first == second
    assert first[0] != kept
    assert step(before, Inputs(), hand.now_ms + 1) != first


def test_a_step_in_place_comes_to_the_same() -> None:
    hand = Hand().to_assist()
    state = copied(hand.state)
    for number in range(400):
        received: tuple[Received, ...] = ()
        if number == 300:
            received = (Received(frames.STOP, b""),)
        elif number % 40 == 0:
            received = (hand.heartbeat(), *(hand.act() if number < 150 else (hand.hold(),)))
        hand.tick(*received)
        advance(state, replace(hand.inputs, frames=received), hand.now_ms)
        assert state == hand.state
        law = state.torque
        assert hand.outputs == (state.outbox, law.assist_unm, law.gravity_unm, state.follow_unm)
    assert hand.state.state == State.ESTOP
