"""The port's backend onto any python-can interface."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from hilbridge.bus.port.backend import LinkDown, WriteResult
from hilbridge.bus.port.spec import BusSpec, BusUnavailable
from hilbridge.bus.quick_can import can
from hilbridge.limits import STALE_COMMAND_NS
from hilbridge.records import Frame

_READ_SLICE_S = 0.1
_TX_QUEUE_LIMIT = 8
_RX_QUEUE_LIMIT = 4096


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
        except Exception as error:  # an absent driver shows as NameError, TypeError and kinds of its own
            said = (str(error).splitlines() or [type(error).__name__])[0]
            raise BusUnavailable(
                f"bus {self._spec}: {said}; python-can's page on {self._spec.interface!r} says what it needs"
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
            if time.monotonic() - queued_s > STALE_COMMAND_NS / 1e9:
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
        with contextlib.suppress(Exception):  # closing fails where the adapter was unplugged
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
