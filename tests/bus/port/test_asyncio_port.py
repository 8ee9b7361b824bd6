"""The port's way back after a link went away, against a backend that does what it is told."""

from __future__ import annotations

import asyncio
import os
from typing import Any

import pytest

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.backend import LinkDown, WriteResult
from hilbridge.bus.port.state import SendResult
from hilbridge.records import Frame


class Gone:
    """A bus whose process died: sending fails, reading says that it has to be opened anew."""

    is_physical = False
    overflowed = 0

    def __init__(self) -> None:
        self.reading, self.writing = os.pipe()
        self.is_gone = False
        self.reopened = asyncio.Event()
        self._loop = asyncio.get_running_loop()

    def fileno(self) -> int:
        return self.reading

    def read(self) -> Frame | None:
        if self.is_gone:
            raise LinkDown("the simulated bus has gone", reopen=True)
        return None

    def write(self, frame: Frame) -> WriteResult:
        return WriteResult.DOWN if self.is_gone else WriteResult.SENT

    def is_up(self) -> bool:
        return not self.is_gone

    def reopen(self) -> None:
        self.is_gone = False
        self._loop.call_soon_threadsafe(self.reopened.set)

    def close(self) -> None:
        os.close(self.reading)
        os.close(self.writing)


@pytest.mark.parametrize("sends_first", [True, False])
async def test_a_failed_send_before_the_end_of_the_stream_does_not_keep_the_port_from_reopening(
    sends_first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    backend = Gone()

    def opened(port: BusPort) -> Any:
        return backend

    monkeypatch.setattr(BusPort, "_open_backend", opened)
    async with BusPort.open("hilsim:gone", listen_only=False) as port:
        await asyncio.sleep(0)
        backend.is_gone = True
        if sends_first:
            assert port.send(Frame(0x060, b"")) is SendResult.DOWN
        os.write(backend.writing, b"x")  # the descriptor becomes readable: the end of the stream
        async with asyncio.timeout(10):
            await backend.reopened.wait()
            while not port.state.link_up:
                await asyncio.sleep(0)
        assert (port.counters.link_downs, port.counters.link_ups) == (1, 1)
        assert port.send(Frame(0x060, b"")) is SendResult.SENT
