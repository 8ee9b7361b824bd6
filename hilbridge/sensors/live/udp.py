"""Samples over UDP from anything: one JSON object a line, a datagram one or more lines (docs/live-gaze.md)."""

from __future__ import annotations

import json
import socket
import time
from abc import abstractmethod
from collections.abc import Callable
from typing import Any, TypeVar

from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.records import BodySample, GazeSample, StampSource
from hilbridge.sensors.clock import DeviceClock, Probe
from hilbridge.sensors.live.base import LiveDevice, Raw, RawBody, RawGaze

_PROBE_EVERY_NS = 200 * MS
_PROBE_FAST_NS = 20 * MS  # until the clock is known
_SILENT_NS = 500 * MS
_READ_S = 0.05
_LONGEST = 65_536
T = TypeVar("T")


class UdpLines(LiveDevice[T]):
    """Listens on `host:port` for `what` (gaze, inertial, skeleton).

    A sender that stamps its samples is asked for its clock; others are stamped on arrival.

    Only one sender is listened to at a time: another one is heard when the first has been silent for half a second.
    Raises InputError when the port cannot be had.
    """

    def __init__(
        self,
        what: str,
        port: int,
        host: str = "127.0.0.1",
        *,
        latency_ns: int = 0,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(
            f"{what} udp:{port}", DeviceClock(), stamp=StampSource.HARDWARE, latency_ns=latency_ns, clock_ns=clock_ns
        )
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise InputError(f"{what} udp:{host}:{port}: {error.strerror}; name a port that is free") from None
        self.port = int(self._socket.getsockname()[1])
        self._socket.settimeout(_READ_S)
        self._sender: tuple[str, int] | None = None
        self._heard_ns = clock_ns()
        self._asked_ns: dict[int, int] = {}
        self._last_asked_ns = 0
        self._stamped = False
        self._next_probe = 0

    def stop(self, timeout_s: float = 2.0) -> None:
        super().stop(timeout_s)
        self._socket.close()

    def _read_all(self) -> None:
        while not self._stopping.is_set():
            self._read_one()

    def _read_one(self) -> None:
        try:
            data, sender = self._socket.recvfrom(_LONGEST)
        except OSError:  # nothing came, or the sender's port is closed
            data, sender = b"", self._sender
        now_ns = self._clock_ns()
        if data and sender is not None and self._is_listened_to(sender, now_ns):
            self._heard_ns = now_ns
            for line in data.splitlines():
                if line.strip():
                    self._take_line(line, now_ns)
        elif not data and now_ns - self._heard_ns > _SILENT_NS:
            self.lose("nothing comes")
        self._ask(now_ns)

    def _is_listened_to(self, sender: tuple[str, int], now_ns: int) -> bool:
        if sender == self._sender:
            return True
        if self._sender is not None and now_ns - self._heard_ns <= _SILENT_NS:
            self.cell.fail()
            return False
        assert self.clock is not None
        self._sender, self._stamped = sender, False
        self._asked_ns.clear()
        self.clock.forget()
        return True

    def _take_line(self, line: bytes, now_ns: int) -> None:
        try:
            found = json.loads(line)
            if "probe" in found:
                sent_ns = self._asked_ns.pop(int(found["probe"]), None)
                if sent_ns is not None:
                    self.take_probe(Probe(sent_ns, int(found["t_ns"]), now_ns))
                return
            stamp = found.get("t_ns")
            raw = self._raw(found, None if stamp is None else int(stamp))
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError):
            self.cell.fail()
            self.say("a line is no sample (`hilbridge docs live-gaze`)")
            return
        self._stamped = self._stamped or stamp is not None
        if self._stamped and stamp is None:
            self.cell.fail()  # a sender either stamps all its samples or none
            return
        self.take_raw(raw)

    @abstractmethod
    def _raw(self, found: dict[str, Any], remote_ns: int | None) -> Raw[T]:
        """The sample of a line. Raises ValueError, TypeError or KeyError for one that is none."""

    def _ask(self, now_ns: int) -> None:
        assert self.clock is not None
        every_ns = _PROBE_EVERY_NS if self.clock.fit is not None else _PROBE_FAST_NS
        if self._sender is None or not self._stamped or now_ns - self._last_asked_ns < every_ns:
            return
        self._last_asked_ns = now_ns
        self._next_probe += 1
        self._asked_ns[self._next_probe] = self._clock_ns()
        while len(self._asked_ns) > 50:
            self._asked_ns.pop(next(iter(self._asked_ns)))
        try:
            self._socket.sendto(json.dumps({"probe": self._next_probe}).encode() + b"\n", self._sender)
        except OSError:  # the network is gone: doubt grows until it is back
            pass


class UdpGaze(UdpLines[GazeSample]):
    """Points of regard: `x`, `y`, and where said `valid`, `worn`."""

    def __init__(
        self,
        port: int,
        host: str = "127.0.0.1",
        *,
        latency_ns: int = 0,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__("gaze", port, host, latency_ns=latency_ns, clock_ns=clock_ns)

    def _raw(self, found: dict[str, Any], remote_ns: int | None) -> RawGaze:
        valid, worn = found.get("valid", True), found.get("worn", True)
        return RawGaze(float(found["x"]), float(found["y"]), valid is True, worn is True, remote_ns)


class UdpBody(UdpLines[BodySample]):
    """Sensors on the body: `x`, `y`, `z`, and where there are several `sensor`; `default` is the name of one without."""

    def __init__(
        self,
        what: str,
        port: int,
        host: str,
        default: str,
        *,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._default = default
        super().__init__(what, port, host, clock_ns=clock_ns)

    def _raw(self, found: dict[str, Any], remote_ns: int | None) -> RawBody:
        sensor = found.get("sensor", self._default)
        if not isinstance(sensor, str):
            raise TypeError("sensor")
        return RawBody(sensor[:64], float(found["x"]), float(found["y"]), float(found["z"]), remote_ns)
