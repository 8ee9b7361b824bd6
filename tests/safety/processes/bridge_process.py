"""A bridge as a process of its own: the real port, link and protocol machine, and a gate that always wishes to ACT.

SIGUSR1 stalls its loop for a second, as a garbage collection or a blocked disk would.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import signal
import sys
import time

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.state import SendResult
from hilbridge.core.bridge import Bridge, BridgeConfig
from hilbridge.limits import TICK_NS
from hilbridge.records import Action, GateDecision, HoldReason
from hilbridge.wire.codec import Decoded, RejectReason
from hilbridge.wire.keys import DEMO_KEY
from hilbridge.wire.link import WireLink
from hilbridge.wire.secoc import Authenticator
from tests.safety.rig import codec

_POUR = GateDecision(Action.ACT, 9, 0.9, HoldReason.NONE)


async def run(spec: str) -> None:
    """Until killed."""
    link = WireLink(codec())
    bridge = Bridge(link, Authenticator(DEMO_KEY), lambda: secrets.randbits(32), BridgeConfig(), lambda: link.counters)
    stall = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGUSR1, stall.set)
    async with BusPort.open(spec, listen_only=False) as port:

        def send(sent: list) -> None:
            for frame in sent:
                result = port.send(frame)
                if result in (SendResult.FULL, SendResult.DOWN):
                    bridge.on_send_failed(result is SendResult.DOWN)

        async def listen() -> None:
            while True:
                frame = await port.receive()
                message = link.decode(frame)
                if isinstance(message, Decoded):
                    send(bridge.on_message(message.name, message.signals, message.counter, time.monotonic_ns()))
                elif message.reason is RejectReason.UNKNOWN_ID:
                    bridge.session.on_stranger(message.name, time.monotonic_ns())

        listening = asyncio.create_task(listen())
        due_ns = time.monotonic_ns()
        with contextlib.suppress(asyncio.CancelledError):
            while True:
                if stall.is_set():
                    stall.clear()
                    time.sleep(1.0)  # noqa: ASYNC251  blocking the loop is the point
                now_ns = time.monotonic_ns()
                bridge.begin_tick(now_ns)
                send(bridge.tick(_POUR, now_ns - 20_000_000, (True, True, True), 7, now_ns))
                due_ns = max(due_ns + TICK_NS, now_ns)
                await asyncio.sleep(max(0.0, (due_ns - time.monotonic_ns()) * 1e-9))
        listening.cancel()


if __name__ == "__main__":
    asyncio.run(run(sys.argv[1]))
