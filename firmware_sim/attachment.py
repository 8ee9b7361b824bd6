"""The device's hold on the bus: any python-can interface, never waiting for it, through link down and up."""

from __future__ import annotations

import errno
import socket
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

from firmware_sim.memory import Received
from firmware_sim.quick_can import can

VIRTUAL_INTERFACES = frozenset({"hilsim", "virtual"})
_GIVES_BACK = ("udp_multicast",)
_READS_AT_ONCE = 4096
_RECEIVE_BUFFER = 4 * 1024 * 1024
_REOPEN_NS = 100_000_000
_LOOK_AGAIN_NS = 1_000_000_000  # at the wall clock, which somebody may set
_ERROR_BUS_OFF = 0x040  # linux/can/error.h
_ERROR_RESTARTED = 0x100


class BusUnusable(ValueError):
    """The bus cannot be opened; the message is one line with the cure."""


class Spec(NamedTuple):
    """python-can interface and channel; `physical` is whether it may reach a wire."""

    interface: str
    channel: str
    physical: bool


class Arrival(NamedTuple):
    """A frame and when it arrived, on the monotonic clock."""

    arrived_ns: int
    frame: Received


def _kernel_has_vcan0() -> bool:
    return sys.platform == "linux" and Path("/sys/class/net/vcan0").exists()


def parse_spec(text: str) -> Spec:
    """`auto`, `vcan0`, `can0`, `hilsim:NAME` or any python-can `interface:channel`. Raises BusUnusable.

    Virtual is what cannot reach a wire: the simulated bus, in-process buses, and vcan without a device behind it.
    """
    if text == "auto":
        text = "vcan0" if _kernel_has_vcan0() else "hilsim:hilbridge"
    interface, colon, channel = text.partition(":")
    if not colon:
        interface, channel = "socketcan", text
    if not interface or not channel:
        raise BusUnusable(f"bus {text!r}: write auto, an interface such as can0, or interface:channel")
    if interface in _GIVES_BACK:
        raise BusUnusable(
            f"bus {text}: {interface} gives a node its own frames back, taken for a second device; use hilsim:NAME"
        )
    if interface == "socketcan":
        virtual = channel.startswith(("vcan", "vxcan")) and not Path("/sys/class/net", channel, "device").exists()
    else:
        virtual = interface in VIRTUAL_INTERFACES
    return Spec(interface, channel, not virtual)


def _why_not(spec: Spec, error: Exception) -> str:
    """One line with the cure that fits: a link that is down, a kernel without CAN, a driver that is not there."""
    cannot = f"bus {spec.interface}:{spec.channel} cannot be opened"
    if spec.interface == "socketcan":
        if isinstance(error, OSError) and error.errno == errno.EAFNOSUPPORT:
            return f"{cannot}: this kernel has no CAN; --bus hilsim:demo needs none"
        return f"{cannot}: {error}; `ip link set {spec.channel} up`, or --bus hilsim:demo, which needs no link"
    kind = "" if isinstance(error, can.CanError | OSError | ValueError) else f"{type(error).__name__}: "
    return f"{cannot}: {kind}{error}; python-can's page on {spec.interface!r} says what its driver needs"


class Attachment:
    """One open bus. Nothing here raises once it is open: a link that is down is silence, counted."""

    def __init__(self, spec: Spec, **options: Any) -> None:
        """Attach; `options` go to python-can. Raises BusUnusable in one line."""
        self.spec = spec
        self._options = options
        self.bus_off = False
        self.dropped = 0
        self.link_errors = 0
        self.received = 0
        self.sent = 0
        self._last_ns = 0
        self._retry_ns: int | None = None  # when a bus that was lost may be opened anew; one that was closed never
        self._bus: can.BusABC | None = self._open()
        self._wall: tuple[int, int] | None = None  # wall clock minus monotonic clock, and when that was looked at

    def _open(self) -> can.BusABC:
        try:
            bus = can.Bus(interface=self.spec.interface, channel=self.spec.channel, **self._options)
        except Exception as error:  # an absent driver raises whatever its binding stumbles over, NameError among it
            raise BusUnusable(_why_not(self.spec, error)) from None
        raw = getattr(bus, "socket", None)
        if isinstance(raw, socket.socket):
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        return bus

    def _lost(self, bus: can.BusABC, now_ns: int) -> None:
        """An error from the driver. A SocketCAN socket outlives its link; anything else is opened anew."""
        self.link_errors += 1
        if self.spec.interface != "socketcan":
            bus.shutdown()
            self._bus = None
            self._retry_ns = now_ns + _REOPEN_NS

    def _ready(self, now_ns: int) -> can.BusABC | None:
        if self._bus is None and self._retry_ns is not None and now_ns >= self._retry_ns:
            try:
                self._bus = self._open()
            except BusUnusable:
                self._retry_ns = now_ns + _REOPEN_NS
        return self._bus

    def _arrival_ns(self, message: can.Message, now_ns: int) -> int:
        """Kernel stamps are wall clock: shifted to the monotonic clock, never in the future, never out of order."""
        if self._wall is None or now_ns - self._wall[1] > _LOOK_AGAIN_NS:
            self._wall = time.time_ns() - time.monotonic_ns(), now_ns
        stamp_ns = round(message.timestamp * 1e9) - self._wall[0] if message.timestamp else now_ns
        self._last_ns = max(self._last_ns, min(stamp_ns, now_ns))
        return self._last_ns

    def read(self, now_ns: int) -> list[Arrival]:
        """Everything that waits, in order of arrival. Error frames set `bus_off` and go no further."""
        bus = self._ready(now_ns)
        arrivals: list[Arrival] = []
        if bus is None:
            return arrivals
        try:
            while len(arrivals) < _READS_AT_ONCE and (message := bus.recv(0)) is not None:
                if message.is_error_frame:
                    self._error_frame(message.arbitration_id)
                    continue
                self.received += 1
                plain = not (message.is_extended_id or message.is_remote_frame or message.is_fd)
                frame = Received(message.arbitration_id, bytes(message.data), plain)
                arrivals.append(Arrival(self._arrival_ns(message, now_ns), frame))
        except (can.CanError, OSError):
            self._lost(bus, now_ns)
        return arrivals

    def _error_frame(self, error_class: int) -> None:
        if error_class & _ERROR_RESTARTED:
            self.bus_off = False
        elif error_class & _ERROR_BUS_OFF:
            self.bus_off = True

    def send(self, can_id: int, data: bytes, now_ns: int) -> None:
        """Send without waiting; what does not go at once is dropped and counted, never sent late."""
        bus = self._ready(now_ns)
        if bus is None:
            self.dropped += 1
            return
        message = can.Message(arbitration_id=can_id, data=data, is_extended_id=False)
        try:
            bus.send(message, timeout=0)
            self.sent += 1
        except (can.CanError, OSError):
            self.dropped += 1

    def close(self) -> None:
        """Leave the bus, for good."""
        self._retry_ns = None
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None
