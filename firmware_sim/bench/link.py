"""A RemoteDevice with its plant bus: readings taken in before each tick, torque sent after it."""

from __future__ import annotations

import time

from firmware_sim.attachment import Attachment, Spec, parse_spec
from firmware_sim.bench.remote import RemoteDevice
from firmware_sim.memory import ControllerState, Received

BITRATE = 1_000_000  # of the plant bus; a kernel's interface has been given its own


def attach(text: str) -> Attachment:
    """The plant bus of this name. Raises BusUnusable."""
    spec: Spec = parse_spec(text)
    return Attachment(spec, **({"bitrate": BITRATE} if spec.interface == "hilsim" else {}))


class LinkedDevice(RemoteDevice):
    """What `firmware-sim --plant-bus` runs."""

    def __init__(self, state: ControllerState, bus: Attachment) -> None:
        super().__init__(state)
        self._bus = bus

    def tick(
        self, frames: tuple[Received, ...], random_u32: int, stall_ticks: int = 0, dropped: int = 0
    ) -> tuple[tuple[int, bytes], ...]:
        """As RemoteDevice.tick, with the plant bus before and after."""
        now_ns = time.monotonic_ns()
        for arrival in self._bus.read(now_ns):
            if arrival.frame.plain:
                self.hear(arrival.frame.can_id, arrival.frame.data)
        outgoing = super().tick(frames, random_u32, stall_ticks, dropped)
        self._bus.send(*self.answer(), now_ns)
        return outgoing
