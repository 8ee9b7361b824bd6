"""The bridge's port with a tap on either way: frames vanish, wait, change and double before node or bus sees them."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.spec import BusSpec
from hilbridge.bus.port.state import PortState, SendResult
from hilbridge.records import Frame
from hilscenario.world.tap import Tap

_SOON_S = 0.001


class TappedPort(BusPort):
    """A port whose `out` and `into` taps see every frame first."""

    def __init__(
        self, spec: BusSpec, out: Tap, into: Tap, on_change: Callable[[PortState], None], options: dict[str, Any]
    ) -> None:
        """Not yet connected. `options` go to the bus as those of `BusPort.open` do."""
        super().__init__(spec, options, listen_only=False, on_change=on_change, clock=time.monotonic_ns)
        self.out, self.into = out, into
        self._releasing: deque[Frame] = deque()

    def send(self, frame: Frame) -> SendResult:
        """As the port; a frame that the tap keeps counts as sent, as a chip's queue would have it."""
        result = SendResult.SENT
        now_ns = self._clock()
        for when_ns, can_id, data in self.out.send(frame.can_id, frame.data, now_ns):
            changed = frame._replace(can_id=can_id, data=data)
            if when_ns > now_ns:
                self._loop.call_later((when_ns - now_ns) / 1e9, super().send, changed)
            else:
                result = super().send(changed)
        return result

    def release(self) -> None:
        """A stale queue that ends: everything that waited goes out, as fast as the bus takes it."""
        self._releasing.extend(Frame(can_id, data) for can_id, data in self.out.release())
        self._release_more()

    def _release_more(self) -> None:
        # One that waits in the port would be replaced by the next of its identifier: let it go first.
        while self._releasing and not self._pending:
            super().send(self._releasing.popleft())
        if self._releasing:
            self._loop.call_later(_SOON_S, self._release_more)

    def _take(self, frame: Frame) -> None:
        if frame.is_error:
            super()._take(frame)
            return
        now_ns = self._clock()
        for when_ns, can_id, data in self.into.send(frame.can_id, frame.data, now_ns):
            changed = frame._replace(can_id=can_id, data=data)
            if when_ns > now_ns:
                late = changed._replace(received_ns=when_ns)
                self._loop.call_later((when_ns - now_ns) / 1e9, super()._take, late)
            else:
                super()._take(changed)
