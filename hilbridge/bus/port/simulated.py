"""The port's backend onto a simulated bus."""

from __future__ import annotations

import time
from typing import Any

from hilbridge.bus.model.events import Enqueued
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.port.backend import LinkDown, WriteResult
from hilbridge.bus.port.spec import BusSpec, BusUnavailable
from hilbridge.bus.simulated.client import BusClient, BusNotReachable, Rates
from hilbridge.records import Frame


class SimulatedBackend:
    """The simulated bus, straight from its socket."""

    is_physical = False

    def __init__(self, spec: BusSpec, options: dict[str, Any]) -> None:
        """Attach (starting the bus if need be). Raises BusUnavailable."""
        self._spec = spec
        self._node = str(options.get("node", ""))
        self._rates = Rates(**{name: int(options[name]) for name in Rates._fields if name in options})
        self.overflowed = 0
        self._client = self._open(start=True)

    def _open(self, *, start: bool) -> BusClient:
        try:
            client = BusClient(
                self._spec.channel,
                node=self._node,
                rates=self._rates,
                start=start,
            )
        except (BusNotReachable, ValueError) as error:
            raise BusUnavailable(f"bus {self._spec}: {error}") from error
        self._wall_offset_ns = time.time_ns() - time.monotonic_ns()
        return client

    def fileno(self) -> int:
        """The descriptor frames arrive on."""
        return self._client.fileno()

    def read(self) -> Frame | None:
        """One frame or None. Raises LinkDown when the bus's process has gone."""
        try:
            arrival = self._client.receive()
        except OSError as error:
            raise LinkDown(str(error), reopen=True) from error
        if arrival is None:
            return None
        self.overflowed = arrival.dropped
        frame = arrival.frame
        return Frame(
            frame.can_id,
            frame.data,
            arrival.stamp_ns,
            arrival.stamp_ns + self._wall_offset_ns,
            is_error=arrival.error,
            is_fd=frame.is_fd,
            is_extended=frame.is_extended,
            hardware_ns=arrival.stamp_ns,
            is_remote=frame.is_remote,
        )

    def write(self, frame: Frame) -> WriteResult:
        """Queue a frame at this node's simulated controller."""
        wire = WireFrame(
            frame.can_id,
            frame.data,
            frame.is_extended,
            frame.is_fd,
            bit_rate_switch=frame.is_fd,
            is_remote=frame.is_remote,
        )
        try:
            outcome = self._client.send(wire)
        except OSError:
            return WriteResult.DOWN
        return {
            Enqueued.QUEUED: WriteResult.SENT,
            Enqueued.FULL: WriteResult.FULL,
            Enqueued.BUS_OFF: WriteResult.FULL,  # like a kernel interface: tried again for a while, then stale
        }.get(outcome, WriteResult.REFUSED)

    def is_up(self) -> bool:
        """True: a simulated bus is up while its process lives, and `reopen` finds out."""
        return True

    def reopen(self) -> None:
        """Attach again; starts the bus anew where its process has gone. Raises BusUnavailable."""
        self._client.close()
        self._client = self._open(start=True)
        self.overflowed = 0

    def close(self) -> None:
        """Leave the bus."""
        self._client.close()
