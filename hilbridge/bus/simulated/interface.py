"""The simulated bus as an ordinary python-can interface: `can.Bus(interface="hilsim", channel=NAME)` in any process.

The first one to open a name starts the bus's server process (`server`); `serve` runs one explicitly. With a
`network.Network` as channel the same class works within one process, without threads and on the network's clock.
"""

from __future__ import annotations

import errno
import time
from typing import Any

from hilbridge.bus.model.error_frames import ErrorState
from hilbridge.bus.model.events import Enqueued
from hilbridge.bus.model.frames import WireFrame, frame_fault
from hilbridge.bus.quick_can import can
from hilbridge.bus.simulated.client import BusClient, BusNotReachable, Rates
from hilbridge.bus.simulated.network import Network, NothingToCome, Station
from hilbridge.bus.simulated.protocol import Arrival
from hilbridge.bus.simulated.server import serve

__all__ = ["Network", "SimulatedBus", "message_of", "serve", "wire_frame_of"]

_STATES = {
    ErrorState.ACTIVE: can.BusState.ACTIVE,
    ErrorState.WARNING: can.BusState.ACTIVE,
    ErrorState.PASSIVE: can.BusState.PASSIVE,
    ErrorState.BUS_OFF: can.BusState.ERROR,
}


def wire_frame_of(message: can.Message) -> WireFrame:
    """A python-can message as the frame its sender would put on the wire."""
    if message.is_remote_frame:
        return WireFrame(message.arbitration_id, b"", message.is_extended_id, is_remote=True, remote_length=message.dlc)
    if not message.is_fd:
        return WireFrame(message.arbitration_id, bytes(message.data), message.is_extended_id)
    return WireFrame(
        message.arbitration_id,
        bytes(message.data),
        message.is_extended_id,
        True,
        message.bitrate_switch,
        message.error_state_indicator,
    )


def message_of(arrival: Arrival, channel: str, wall_offset_ns: int) -> can.Message:
    """A received frame as a python-can message, stamped in seconds (Unix time across processes)."""
    frame, stamp_ns, own, error, _ = arrival
    return can.Message(
        (stamp_ns + wall_offset_ns) / 1e9,
        frame.can_id,
        frame.is_extended,
        frame.is_remote,
        error,
        channel,
        frame.remote_length if frame.is_remote else None,
        None if frame.is_remote else frame.data,
        frame.is_fd,
        not own,
        frame.bit_rate_switch,
        frame.error_state_indicator,
    )


class SimulatedBus(can.BusABC):
    """One node of a simulated CAN bus shared by all processes of this machine that open the same channel."""

    def __init__(
        self,
        channel: str | Network = "hilbridge",
        can_filters: can.typechecking.CanFilters | None = None,
        receive_own_messages: bool = False,
        listen_only: bool = False,
        bus_errors: bool = False,
        node: str = "",
        fd: bool = False,
        bitrate: int = 500_000,
        data_bitrate: int = 2_000_000,
        **kwargs: Any,
    ) -> None:
        """Attach to the bus called `channel` as the node called `node` (the name by which faults find it).

        `bitrate` and `data_bitrate` (bit/s) hold where this starts the bus. Changes of the controller's state arrive as
        error frames, with `bus_errors` each failed attempt too. A `listen_only` node does not even acknowledge.
        Raises can.CanInitializationError where no bus can be reached.
        """
        self.node: BusClient | Station
        try:
            if isinstance(channel, Network):
                self.node = channel.attach(
                    node, listen_only=listen_only, receive_own=receive_own_messages, bus_errors=bus_errors
                )
                self._channel, self._wall_offset_ns = "network", 0
            else:
                self.node = BusClient(
                    str(channel),
                    listen_only=listen_only,
                    receive_own=receive_own_messages,
                    bus_errors=bus_errors,
                    node=node,
                    rates=Rates(int(bitrate), int(data_bitrate)),
                )
                self._channel, self._wall_offset_ns = str(channel), time.time_ns() - time.monotonic_ns()
        except (BusNotReachable, ValueError) as error:
            self._is_shutdown = True
            raise can.CanInitializationError(str(error)) from error
        self.channel_info = f"simulated bus {self._channel}"
        self._can_protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
        super().__init__(channel=channel, can_filters=can_filters, **kwargs)  # type: ignore[arg-type]

    def fileno(self) -> int:
        """A descriptor that is readable exactly while a frame waits; a network within the process has none."""
        if isinstance(self.node, Station):
            raise NotImplementedError("a network within one process has no descriptor")
        return self.node.fileno()

    def _gone(self) -> can.CanOperationError:
        return can.CanOperationError(f"the simulated bus {self._channel} has gone", errno.ENETDOWN)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next message that passes the filters, waiting `timeout` seconds at most (None: for ever).

        Within one process these are seconds of the network's clock; python-can's own loop would count the computer's.
        Raises can.CanOperationError where the bus has gone, or where nobody could ever send.
        """
        if not isinstance(self.node, Station):
            return super().recv(timeout)
        clock = self.node.network.clock
        deadline_ns = None if timeout is None else clock.now_ns() + int(timeout * 1e9)
        while True:
            try:
                arrival = self.node.receive_until(deadline_ns)
            except NothingToCome as error:
                raise can.CanOperationError(str(error)) from error
            if arrival is None:
                return None
            message = message_of(arrival, self._channel, self._wall_offset_ns)
            if self._filters is None or self._matches_filters(message):
                return message

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        assert isinstance(self.node, BusClient)
        try:
            arrival = self.node.receive() or self._wait(self.node, timeout)
        except OSError as error:
            raise self._gone() from error
        return (None if arrival is None else message_of(arrival, self._channel, self._wall_offset_ns)), False

    def _wait(self, node: BusClient, timeout: float | None) -> Arrival | None:
        deadline_s = None if timeout is None else time.monotonic() + timeout
        while True:
            left_s = None if deadline_s is None else deadline_s - time.monotonic()
            if (left_s is not None and left_s <= 0) or not node.wait_readable(left_s):
                return None
            arrival = node.receive()
            if arrival is not None:  # None: so far only a part of it
                return arrival

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Queue a frame. Raises can.CanOperationError (ENOBUFS) where the queue stays full for `timeout` seconds."""
        frame = wire_frame_of(msg)
        try:
            outcome = self.node.send(frame, timeout or 0.0)
        except OSError as error:
            raise self._gone() from error
        if outcome is not Enqueued.QUEUED:
            number = errno.ENOBUFS if outcome is Enqueued.FULL else errno.ENETDOWN
            fault = frame_fault(frame) if outcome is Enqueued.BAD_FRAME else None
            raise can.CanOperationError(f"not sent: {fault or outcome}", number)

    @property
    def state(self) -> can.BusState:
        """Error-active, error-passive, or (ERROR) bus-off."""
        try:
            self.node.refresh()
        except OSError as error:
            raise self._gone() from error
        return _STATES[self.node.state]

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        if new_state is not can.BusState.ACTIVE:
            raise NotImplementedError("only ACTIVE can be asked for: to recover from bus-off")
        self.node.recover()

    def shutdown(self) -> None:
        """Leave the bus. May be called again."""
        super().shutdown()
        self.node.close()
