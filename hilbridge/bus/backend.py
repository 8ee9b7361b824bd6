"""What the port needs of whatever carries its frames, and the backends that are not SocketCAN."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from enum import StrEnum
from typing import Any, Protocol

import can

from hilbridge.bus.client import BusClient, BusNotReachable
from hilbridge.bus.events import Enqueued
from hilbridge.bus.frames import WireFrame
from hilbridge.bus.spec import BusSpec, BusUnavailable
from hilbridge.records import Frame


class WriteResult(StrEnum):
    """What became of a frame handed to the backend."""

    SENT = "sent"
    FULL = "full"
    DOWN = "down"
    REFUSED = "refused"


class LinkDown(Exception):
    """The bus is not there now. `reopen` says whether the backend must be opened anew once it is back."""

    def __init__(self, message: str, *, reopen: bool) -> None:
        super().__init__(message)
        self.reopen = reopen


class Backend(Protocol):
    """Carries frames without ever waiting. `overflowed` counts frames lost before they could be read."""

    is_physical: bool
    overflowed: int

    def fileno(self) -> int | None:
        """A descriptor readable while frames wait, or None: then `on_ready` of `start` is called from a thread."""

    def read(self) -> Frame | None:
        """One frame or None. Raises LinkDown."""

    def write(self, frame: Frame) -> WriteResult:
        """Hand over one frame without waiting."""

    def is_up(self) -> bool:
        """Whether the bus is there now."""

    def reopen(self) -> None:
        """Open anew after LinkDown with `reopen`. Raises BusUnavailable."""

    def close(self) -> None:
        """Let go of everything."""


class SimulatedBackend:
    """The simulated bus, straight from its socket."""

    is_physical = False

    def __init__(self, spec: BusSpec, options: dict[str, Any]) -> None:
        """Attach (starting the bus if need be). Raises BusUnavailable."""
        self._spec = spec
        self._bitrate = int(options.get("bitrate", 500_000))
        self._node = str(options.get("node", ""))
        self._data_bitrate = int(options.get("data_bitrate", 2_000_000))
        self.overflowed = 0
        self._client = self._open(start=True)

    def _open(self, *, start: bool) -> BusClient:
        try:
            client = BusClient(
                self._spec.channel,
                node=self._node,
                bitrate=self._bitrate,
                data_bitrate=self._data_bitrate,
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
        """A simulated bus is up while its process lives, which `reopen` finds out."""
        return True

    def reopen(self) -> None:
        """Attach again; starts the bus anew where its process has gone. Raises BusUnavailable."""
        self._client.close()
        self._client = self._open(start=True)
        self.overflowed = 0

    def close(self) -> None:
        """Leave the bus."""
        self._client.close()


_READ_SLICE_S = 0.1
_TX_QUEUE_LIMIT = 8
_RX_QUEUE_LIMIT = 4096
_STALE_S = 0.02


class PythonCanBackend:
    """Any other python-can interface, through one reading and one writing thread.

    Their `recv` and `send` may block (a serial port, a USB driver), and several have no descriptor, or one that does
    not tell of frames already read into user space; so neither is called on the event loop.
    """

    def __init__(self, spec: BusSpec, options: dict[str, Any], on_ready: Callable[[], None]) -> None:
        """Open the interface. `on_ready` is called from a thread when frames wait. Raises BusUnavailable."""
        self._spec, self._options, self._on_ready = spec, options, on_ready
        self.is_physical = not spec.is_simulated
        self.overflowed = 0
        self.stale = 0
        self._received: deque[Frame] = deque()
        self._lost: str | None = None
        self._start()

    def _start(self) -> None:
        try:
            self._bus = can.Bus(interface=self._spec.interface, channel=self._spec.channel, **self._options)
        except (can.CanError, OSError, ValueError, ImportError, TypeError) as error:
            raise BusUnavailable(
                f"bus {self._spec}: {error}; python-can's page on {self._spec.interface!r} says what it needs"
            ) from error
        self._closing = threading.Event()
        self._outgoing: queue.Queue[tuple[float, Frame]] = queue.Queue(_TX_QUEUE_LIMIT)
        self._threads = [
            threading.Thread(target=target, args=(self._bus, self._closing), daemon=True, name=name)
            for target, name in ((self._read_forever, "can-read"), (self._write_forever, "can-write"))
        ]
        for thread in self._threads:
            thread.start()

    def _read_forever(self, bus: can.BusABC, closing: threading.Event) -> None:
        while not closing.is_set():
            try:
                message = bus.recv(_READ_SLICE_S)
            except Exception as error:  # drivers raise their own kinds; any of them means the bus is lost
                if not closing.is_set():
                    self._lose(f"{type(error).__name__}: {error}")
                return
            if message is None:
                continue
            if len(self._received) >= _RX_QUEUE_LIMIT:
                self.overflowed += 1
                continue
            self._received.append(_frame_of(message))
            self._on_ready()

    def _write_forever(self, bus: can.BusABC, closing: threading.Event) -> None:
        while not closing.is_set():
            try:
                queued_s, frame = self._outgoing.get(timeout=_READ_SLICE_S)
            except queue.Empty:
                continue
            if time.monotonic() - queued_s > _STALE_S:
                self.stale += 1
                continue
            try:
                bus.send(_message_of(frame))
            except Exception as error:
                self._lose(f"{type(error).__name__}: {error}")
                return

    def _lose(self, why: str) -> None:
        self._lost = why
        self._on_ready()

    def fileno(self) -> None:
        """None: a thread tells."""
        return

    def read(self) -> Frame | None:
        """One frame or None. Raises LinkDown."""
        if self._received:
            return self._received.popleft()
        if self._lost is not None:
            raise LinkDown(self._lost, reopen=True)
        return None

    def write(self, frame: Frame) -> WriteResult:
        """Give a frame to the writing thread."""
        if self._lost is not None:
            return WriteResult.DOWN
        try:
            self._outgoing.put_nowait((time.monotonic(), frame))
        except queue.Full:
            return WriteResult.FULL
        return WriteResult.SENT

    def is_up(self) -> bool:
        """Only opening it again can tell."""
        return True

    def reopen(self) -> None:
        """Close and open the interface again. Raises BusUnavailable."""
        self.close()
        self._lost = None
        self._start()

    def close(self) -> None:
        """Stop both threads, then close the interface."""
        self._closing.set()
        for thread in self._threads:
            thread.join(timeout=2.0)
        with contextlib.suppress(Exception):  # a driver whose adapter was unplugged cannot say goodbye to it
            self._bus.shutdown()


def _frame_of(message: can.Message) -> Frame:
    now_ns, wall_now_ns = time.monotonic_ns(), time.time_ns()
    stamp_ns = int(message.timestamp * 1e9)
    age_ns = wall_now_ns - stamp_ns
    # Drivers stamp in Unix time or from their own start; only the former can be carried to the monotonic clock.
    is_unix = 0 <= age_ns < 1_000_000_000
    return Frame(
        message.arbitration_id,
        bytes(message.data),
        now_ns - age_ns if is_unix else now_ns,
        stamp_ns if is_unix else wall_now_ns,
        is_error=message.is_error_frame,
        is_fd=message.is_fd,
        is_extended=message.is_extended_id,
        hardware_ns=stamp_ns,
        is_remote=message.is_remote_frame,
    )


def _message_of(frame: Frame) -> can.Message:
    return can.Message(
        arbitration_id=frame.can_id,
        data=frame.data,
        is_extended_id=frame.is_extended,
        is_fd=frame.is_fd,
        bitrate_switch=frame.is_fd,
        is_remote_frame=frame.is_remote,
    )
