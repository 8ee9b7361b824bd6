"""A line onto a real bus: the bridge's own port, waited for one frame at a time."""

from __future__ import annotations

import asyncio
import time
from types import TracebackType
from typing import Any, Self

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.state import SendResult
from hilbridge.conformance.findings import Unshown
from hilbridge.records import Frame

_GONE = (SendResult.SENT, SendResult.QUEUED)


class BusLine:
    """Opens on entering, may send. Raises BusUnavailable."""

    def __init__(self, spec: str, options: dict[str, Any]) -> None:
        self._port = BusPort.open(spec, listen_only=False, **options)
        self._runner = asyncio.Runner()

    def __enter__(self) -> Self:
        self._runner.__enter__()
        try:
            self._runner.run(self._port.connect())
        except BaseException:
            self._runner.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._runner.run(self._port.close())
        finally:
            self._runner.close()

    def now_ns(self) -> int:
        """The monotonic clock."""
        return time.monotonic_ns()

    def send(self, frame: Frame) -> None:
        """Hand it to the port. Raises Unshown where the bus is down or full."""
        result = self._port.send(frame)
        if result not in _GONE:
            why = self._port.state.reason or "its queue is full: does anybody acknowledge?"
            raise Unshown(f"a frame could not be sent ({result}): {why}")

    def receive(self, until_ns: int) -> Frame | None:
        """The next frame, or None once it is that late."""
        return self._runner.run(self._receive(until_ns))

    async def _receive(self, until_ns: int) -> Frame | None:
        frame = self._port.receive_nowait()
        if frame is not None:
            return frame
        try:
            async with asyncio.timeout((until_ns - time.monotonic_ns()) / 1e9):
                return await self._port.receive()
        except TimeoutError:
            return None
