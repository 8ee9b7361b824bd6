"""The page's end of the bus: it reads every frame, and STOP is the only one that it can send."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.state import SendResult
from hilbridge.limits import STOP_GAP_NS, STOP_REPEATS
from hilbridge.monitor.state import Link, Watch
from hilbridge.records import Frame
from hilbridge.wire.codec import Codec

_WENT_OUT = (SendResult.SENT, SendResult.QUEUED)


class Station:
    """Feeds a `Watch` from a port. `on_change` is called when what a person must see at once has changed."""

    def __init__(self, port: BusPort, watch: Watch, codec: Codec, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self.watch = watch
        self.on_change: Callable[[], None] = lambda: None
        self._port = port
        self._clock = clock
        self._stop = Frame(codec.messages["STOP"].can_id, b"")
        self._shown: tuple[str, ...] = ()

    async def run(self) -> None:
        """Read until cancelled."""
        while True:
            frame: Frame | None = await self._port.receive()
            while frame is not None:
                if not frame.is_error:
                    self.watch.take(frame, self._clock())
                frame = self._port.receive_nowait()
            self.look()

    def look(self) -> None:
        """Let time pass for the watch, and say whether that changed anything."""
        state, lost = self._port.state, self._port.counters.overflow_kernel + self._port.counters.overflow_port
        self.watch.set_link(
            Link(state.link_up, state.reason, state.controller.value, state.tx_errors, state.rx_errors, lost)
        )
        self.watch.advance(self._clock())
        if self.watch.key != self._shown:
            self._shown = self.watch.key
            self.on_change()

    async def stop(self) -> str:
        """STOP three times, 10 ms apart. What became of it, in words; empty where all went out."""
        results = [self._port.send(self._stop)]
        self.watch.tell("STOP sent from the page", self._clock())
        for _ in range(STOP_REPEATS - 1):
            await asyncio.sleep(STOP_GAP_NS / 1e9)
            results.append(self._port.send(self._stop))
        failed = [result for result in results if result not in _WENT_OUT]
        if not failed:
            return ""
        told = f"STOP did not go out {len(failed)} of {len(results)} times ({failed[0].replace('_', ' ')})"
        self.watch.tell(told, self._clock())
        return told
