"""When a picture was taken that has just come, and how that is known. Pure."""

from __future__ import annotations

import math
from collections import deque

from hilbridge.records import StampSource
from hilbridge.sensors.clock import DeviceClock

FAR_OFF_NS = 1_000_000_000  # a stamp further back than this is no stamp of now
_BUCKET_NS = 1_000_000_000
_BUCKETS = 30


def taken_at(said_ms: float, now_ns: int, latency_ns: int, last_ns: int) -> tuple[int, StampSource]:
    """Of a device's picture, by what its driver says.

    V4L2 drivers stamp by the monotonic clock, or by one of their own: a stamp that lies ahead, more than a second back, or
    not after the last one is none. Stamps never go back.
    """
    if math.isfinite(said_ms):
        said_ns = round(said_ms * 1e6)
        if max(last_ns + 1, now_ns - FAR_OFF_NS) <= said_ns <= now_ns:
            return said_ns, StampSource.HARDWARE
    return _forward(now_ns - latency_ns, now_ns, last_ns), StampSource.ARRIVAL


class SenderStamps:
    """Of a stream's pictures, by the sender's wall clock as RTCP reports it.

    `clock` knows that clock where the sender can be asked for it. Otherwise its distance from here is that of the quickest
    arrival of the last half minute, less the latency that the configuration says: jitter is gone then, a constant is not.
    """

    def __init__(self, clock: DeviceClock | None = None) -> None:
        self.clock = clock
        self._quickest: deque[tuple[int, int]] = deque(maxlen=_BUCKETS)  # second, least (arrival - stamp) in it

    def taken_at(self, sender_ns: int | None, now_ns: int, latency_ns: int, last_ns: int) -> tuple[int, StampSource]:
        """When the picture was taken; without a stamp of the sender, or with one that cannot be, on arrival less latency."""
        if sender_ns is not None:
            captured_ns = self._carried(sender_ns, now_ns, latency_ns)
            if captured_ns is not None and now_ns - FAR_OFF_NS <= captured_ns:
                return _forward(captured_ns, now_ns, last_ns), StampSource.RTCP
        return _forward(now_ns - latency_ns, now_ns, last_ns), StampSource.ARRIVAL

    def forget(self) -> None:
        """The connection is another."""
        self._quickest.clear()

    def _carried(self, sender_ns: int, now_ns: int, latency_ns: int) -> int | None:
        if self.clock is not None:
            fit = self.clock.fit
            if fit is None or not self.clock.sure(now_ns):
                return None
            captured_ns = fit.to_local(sender_ns)
            return captured_ns if captured_ns - now_ns <= fit.bound_ns(now_ns) else None
        way_ns = now_ns - sender_ns
        if self._quickest and abs(way_ns - min(least for _, least in self._quickest)) > FAR_OFF_NS:
            self._quickest.clear()  # the sender's clock was set
        second = now_ns // _BUCKET_NS
        if self._quickest and self._quickest[-1][0] == second:
            way_ns = min(way_ns, self._quickest.pop()[1])
        self._quickest.append((second, way_ns))
        while second - self._quickest[0][0] >= _BUCKETS:
            self._quickest.popleft()
        return sender_ns + min(least for _, least in self._quickest) - latency_ns


def _forward(captured_ns: int, now_ns: int, last_ns: int) -> int:
    """Stamps neither go back nor lie ahead."""
    return max(min(captured_ns, now_ns), min(last_ns + 1, now_ns))
