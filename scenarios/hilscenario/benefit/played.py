"""A session on the worn arm: the device is given what a bridge asked for, and moves as its own controller decides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_sim.memory import ControllerState
from firmware_sim.plant.drive import Drive
from firmware_sim.states import Event, Reason, State
from firmware_sim.transitions import fire
from firmware_sim.watchdogs import NEUTRAL_HOLDS
from firmware_sim.worn_device import WornDevice
from hilscenario.benefit.gates import Order
from hilscenario.benefit.visits import Visit, person_of

STEP_S = 0.001
NO_ACT, RIGHT, WRONG = range(3)
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Played:
    """A value a millisecond.

    hand: from the shoulder, forwards and up, m. pitch: the forearm's from hanging, rad. power: what assist and gravity
    support, behind the drive, give to the arm, W. effect: of which ACT that is (NO_ACT, RIGHT, WRONG).
    """

    hand: Array
    pitch: Array
    power: Array
    effect: NDArray[np.int8]
    latched: bool


class Ordered:
    """Takes orders to a controller by its one table of events, as commands that it has accepted would.

    A bridge holds while its device follows; so here an order in FOLLOW is a HOLD, and three of them make it ready.
    """

    def __init__(self, state: ControllerState) -> None:
        self._state, self._holds, self._effect = state, 0, NO_ACT

    def tell(self, order: Order, now_ms: int) -> None:
        """One tick of the bridge."""
        state = self._state
        if state.state is State.FOLLOW:
            self._holds += 1
            if self._holds >= NEUTRAL_HOLDS:
                fire(state, Event.NEUTRAL, Reason.NEUTRAL, now_ms)
            return
        self._holds = 0
        if order.verb is None:
            fire(state, Event.HOLD, Reason.HOLD, now_ms)
            return
        code = order.verb + 1
        if state.state is State.READY:
            state.verb = code
        if code == state.verb:
            fire(state, Event.ACT, Reason.AUTHORISED, now_ms)
        else:
            fire(state, Event.VERB_CHANGE, Reason.VERB_CHANGE, now_ms)
        if state.state is State.ASSIST:
            self._effect = RIGHT if order.right else WRONG

    def effect(self) -> int:
        """Of which ACT the torque is; what is left of one on its way out is its own."""
        state = self._state
        if state.state not in (State.ASSIST, State.RAMP_DOWN) and not state.torque.gravity_unm:
            self._effect = NO_ACT
        return self._effect


def play(visit: Visit, asked: Sequence[Order]) -> Played:
    """The session with these orders; none at all: the device is left in FOLLOW."""
    device = WornDevice(person_of(visit))
    arm, law, added = device.arm, device.state.torque, Drive(device.drive.preset)
    ordered, count, latched = Ordered(device.state), visit.milliseconds, False
    hand, pitch, power = np.empty((count, 2)), np.empty(count), np.empty(count)
    effect = np.empty(count, np.int8)
    orders = {order.at_ms: order for order in asked}
    for now_ms in range(count):
        if (order := orders.get(now_ms)) is not None:
            ordered.tell(order, now_ms)
        device.tick()
        hand[now_ms] = arm.hand()
        pitch[now_ms] = arm.angle[0] + arm.angle[1]
        power[now_ms] = added.step((law.assist_unm + law.gravity_unm) * 1e-6, STEP_S) * arm.device_speed[1]
        effect[now_ms] = ordered.effect()
        latched = latched or device.state.state is State.LATCHED
    return Played(hand, pitch, power, effect, latched)
