"""The asyncio port onto any CAN bus: it never blocks, survives the link going down and up, and counts what is lost.

python-can's asyncio Notifier hangs when a link goes down and its `send(timeout=)` blocks the loop, so the port
owns the descriptor itself. Silence is not an error here: deadlines belong to the session.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from types import TracebackType
from typing import Any, Self

from hilbridge.bus.model.error_frames import ErrorState, read_error_frame
from hilbridge.bus.port.backend import Backend, LinkDown, WriteResult
from hilbridge.bus.port.python_can import PythonCanBackend
from hilbridge.bus.port.simulated import SimulatedBackend
from hilbridge.bus.port.socketcan import SocketCanBackend
from hilbridge.bus.port.spec import BusSpec, BusUnavailable, parse_spec
from hilbridge.bus.port.state import PortCounters, PortState, SendResult
from hilbridge.limits import STALE_COMMAND_NS
from hilbridge.records import Frame

_READS_PER_TURN = 256
_RX_LIMIT = 8192  # frames not yet taken by `receive`; at 500 kbit/s about two seconds of a full bus
_PENDING_LIMIT = 8
_RETRY_S = 0.001
_RECOVERY_S = 0.05


class BusPort:
    """One node's connection. Open with `BusPort.open`, use as an async context manager, from one event loop."""

    def __init__(
        self,
        spec: BusSpec,
        options: dict[str, Any],
        *,
        listen_only: bool | None,
        on_change: Callable[[PortState], None] | None,
        clock: Callable[[], int],
    ) -> None:
        self.spec = spec
        self.counters = PortCounters()
        self._options = options
        self._asked_listen_only = listen_only
        self._on_change = on_change
        self._clock = clock
        self._backend: Backend | None = None
        self._received: deque[Frame] = deque()
        self._waiter: asyncio.Future[None] | None = None
        self._pending: dict[tuple[int, bool], tuple[int, Frame]] = {}
        self._retry: asyncio.TimerHandle | None = None
        self._recovery: asyncio.TimerHandle | None = None
        self._watched: int | None = None
        self._overflow_before = 0
        self._state = PortState(False, ErrorState.UNKNOWN, None, None, "not open", 0)

    @classmethod
    def open(
        cls,
        spec: str,
        *,
        listen_only: bool | None = None,
        on_change: Callable[[PortState], None] | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
        **options: Any,
    ) -> BusPort:
        """A port for `auto`, `vcan0`, `can0`, `hilsim:NAME`, any `interface:channel`; connects on `async with`.

        `listen_only` None means: on a physical bus yes, else no (the controller acknowledges all the same). `on_change`
        hears of every change of state. `options` go to python-can (`bitrate=`, ...). Raises BusUnavailable, here for a
        spec nobody can read, else on entering.
        """
        return cls(parse_spec(spec), options, listen_only=listen_only, on_change=on_change, clock=clock)

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def connect(self) -> None:
        """Open the interface. Raises BusUnavailable."""
        self._loop = asyncio.get_running_loop()
        # Opening may start a process or a USB driver: off the loop.
        self._backend = await asyncio.to_thread(self._open_backend)
        self.is_physical = self._backend.is_physical
        self.listen_only = self.is_physical if self._asked_listen_only is None else self._asked_listen_only
        self._change(link_up=True, reason="")
        self._watch()
        self._loop.call_soon(self._on_readable)  # changes before the watch began, such as a link already down

    def _open_backend(self) -> Backend:
        if self.spec.interface == "socketcan":
            return SocketCanBackend(self.spec.channel)
        if self.spec.interface == "hilsim":
            return SimulatedBackend(self.spec, self._options)
        return PythonCanBackend(self.spec, self._options, self._on_ready_from_thread)

    def _on_ready_from_thread(self) -> None:
        try:
            self._loop.call_soon_threadsafe(self._on_readable)
        except RuntimeError:  # the loop has closed under a driver's thread
            return

    def _watch(self) -> None:
        assert self._backend is not None
        descriptor = self._backend.fileno()
        if descriptor is not None:
            self._loop.add_reader(descriptor, self._on_readable)
        self._watched = descriptor

    def _unwatch(self) -> None:
        if self._watched is not None:
            self._loop.remove_reader(self._watched)
            self._watched = None

    @property
    def state(self) -> PortState:
        """The bus as last seen."""
        return self._state

    def _change(self, **fields: Any) -> None:
        changed = replace(self._state, **fields)
        if changed == self._state:
            return
        self._state = replace(changed, changed_ns=self._clock())
        if self._on_change is not None:
            self._on_change(self._state)

    # Receiving

    def _on_readable(self) -> None:
        if self._backend is None:
            return
        for _ in range(_READS_PER_TURN):
            try:
                frame = self._backend.read()
            except LinkDown as lost:
                self._link_lost(str(lost), reopen=lost.reopen)
                break
            if frame is None:
                break
            self._take(frame)
        else:
            if self._watched is None:  # no descriptor that would call again
                self._loop.call_soon(self._on_readable)
        self.counters.overflow_kernel = self._overflow_before + self._backend.overflowed

    def _take(self, frame: Frame) -> None:
        if frame.is_error:
            self.counters.received_errors += 1
            event = read_error_frame(frame.can_id, frame.data)
            if event.controller is not None:
                self._change(controller=event.controller)
            if event.tx_errors is not None:
                self._change(tx_errors=event.tx_errors, rx_errors=event.rx_errors)
        else:
            self.counters.received += 1
        if len(self._received) >= _RX_LIMIT:  # a controller needs the newest most
            self._received.popleft()
            self.counters.overflow_port += 1
        self._received.append(frame)
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    async def receive(self) -> Frame:
        """The next frame (error frames among them), however long it takes. For one consumer at a time."""
        while not self._received:
            self._waiter = self._loop.create_future()
            try:
                await self._waiter
            finally:
                self._waiter = None
        return self._received.popleft()

    def receive_nowait(self) -> Frame | None:
        """The next frame, if one waits."""
        return self._received.popleft() if self._received else None

    # Link

    def _link_lost(self, reason: str, *, reopen: bool) -> None:
        if self._state.link_up:
            self.counters.link_downs += 1
            self._change(link_up=False, reason=reason)
        for _ in range(len(self._pending)):
            self._pending.popitem()
            self.counters.dropped_down += 1
        if reopen:
            self._unwatch()
            if self._recovery is not None:  # a send that failed first may only be waiting for the same link to be up
                self._recovery.cancel()
                self._recovery = None
        if self._recovery is None:
            self._recovery = self._loop.call_later(_RECOVERY_S, self._try_recovery, reopen)

    def _try_recovery(self, reopen: bool) -> None:
        self._recovery = None
        backend = self._backend
        if backend is None or self._state.link_up:
            return
        if reopen:
            self._recovering = self._loop.create_task(self._reopen(backend))
        elif backend.is_up():
            self._link_back()
        else:
            self._recovery = self._loop.call_later(_RECOVERY_S, self._try_recovery, reopen)

    async def _reopen(self, backend: Backend) -> None:
        overflow = self.counters.overflow_kernel
        try:
            await asyncio.to_thread(backend.reopen)
        except BusUnavailable as error:
            self._change(reason=str(error))
            if self._backend is not None:
                self._recovery = self._loop.call_later(_RECOVERY_S, self._try_recovery, True)
            return
        if self._backend is None:  # closed meanwhile
            await asyncio.to_thread(backend.close)
            return
        self._overflow_before = overflow
        self._watch()
        self._link_back()
        self._on_readable()

    def _link_back(self) -> None:
        self.counters.link_ups += 1
        self._change(link_up=True, reason="")

    # Sending

    def send(self, frame: Frame) -> SendResult:
        """Send without ever waiting; what cannot go now is tried for 20 ms, lowest identifier first, or dropped.

        A frame that waits is replaced by a newer one of the same identifier.
        """
        if self._backend is None:
            return SendResult.CLOSED
        if self.listen_only:
            self.counters.dropped_listen_only += 1
            return SendResult.LISTEN_ONLY
        if not self._state.link_up:
            self.counters.dropped_down += 1
            return SendResult.DOWN
        if self._pending:
            return self._defer(frame)
        return self._write(frame)

    @property
    def waiting(self) -> bool:
        """Whether frames wait for room."""
        return bool(self._pending)

    def _write(self, frame: Frame) -> SendResult:
        assert self._backend is not None
        result = self._backend.write(frame)
        if result is WriteResult.SENT:
            self.counters.sent += 1
            return SendResult.SENT
        if result is WriteResult.FULL:
            return self._defer(frame)
        if result is WriteResult.DOWN:
            self.counters.dropped_down += 1
            self._link_lost("sending failed: the link is down", reopen=False)
            return SendResult.DOWN
        self.counters.dropped_refused += 1
        return SendResult.REFUSED

    def _defer(self, frame: Frame) -> SendResult:
        key = (frame.can_id, frame.is_extended)
        if self._pending.pop(key, None) is not None:
            self.counters.dropped_superseded += 1
        elif len(self._pending) >= _PENDING_LIMIT:
            self.counters.dropped_full += 1
            return SendResult.FULL
        self._pending[key] = (self._clock(), frame)
        if self._retry is None:
            self._retry = self._loop.call_later(_RETRY_S, self._retry_pending)
        return SendResult.QUEUED

    def _retry_pending(self) -> None:
        self._retry = None
        if self._backend is None:
            return
        now_ns = self._clock()
        for key in sorted(self._pending):
            queued_ns, frame = self._pending[key]
            if now_ns - queued_ns > STALE_COMMAND_NS:
                del self._pending[key]
                self.counters.dropped_stale += 1
                continue
            self.counters.retried += 1
            if self._backend.write(frame) is not WriteResult.SENT:
                break
            del self._pending[key]
            self.counters.sent += 1
        if self._pending:
            self._retry = self._loop.call_later(_RETRY_S, self._retry_pending)

    async def close(self) -> None:
        """Close the bus. May be called again."""
        backend, self._backend = self._backend, None
        if backend is None:
            return
        self._unwatch()
        for timer in (self._retry, self._recovery):
            if timer is not None:
                timer.cancel()
        self._change(link_up=False, reason="closed")
        await asyncio.to_thread(backend.close)
