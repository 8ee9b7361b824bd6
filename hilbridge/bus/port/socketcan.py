"""A raw, non-blocking SocketCAN socket: overflow counted, kernel and hardware stamps, link loss as a value (Linux)."""

from __future__ import annotations

import errno
import socket
import struct
import time

from hilbridge.bus.port.backend import LinkDown, WriteResult
from hilbridge.bus.port.netlink import LinkInfo, read_link
from hilbridge.bus.port.spec import BusUnavailable, interface_exists
from hilbridge.records import Frame

_AF_CAN, _CAN_RAW = 29, 1
_SOL_CAN_RAW, _RAW_ERR_FILTER, _RAW_FD_FRAMES = 101, 2, 5
_SO_RCVBUFFORCE, _SO_TIMESTAMPING, _SO_RXQ_OVFL = 33, 37, 40
# linux/net_tstamp.h: receive stamps by hardware and software, reported raw and as system time.
_STAMP_FLAGS = 1 << 2 | 1 << 3 | 1 << 4 | 1 << 6
_ERR_MASK = 0x1FFF_FFFF
_RECEIVE_BUFFER_BYTES = 8 << 20
_CLASSICAL = struct.Struct("=IB3x8s")
_FD = struct.Struct("=IBB2x64s")
_CLASSICAL_BYTES, _FD_BYTES = _CLASSICAL.size, _FD.size
_STAMPS = struct.Struct("@qqqqqq")
_ANCILLARY_BYTES = 256
EFF_FLAG, RTR_FLAG, ERR_FLAG = 0x8000_0000, 0x4000_0000, 0x2000_0000
_FD_SWITCH = 0x01
_FULL = frozenset({errno.ENOBUFS, errno.EAGAIN, errno.EWOULDBLOCK, errno.ENOMEM})
_LINK_LOST = frozenset({errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.ENETUNREACH})
_WALL_STEP_NS = 1_000_000_000  # a kernel stamp further than this from now is a stepped clock, not a slow reader


def parse_can_frame(raw: bytes, received_ns: int, wall_ns: int, hardware_ns: int) -> Frame | None:
    """Read a `struct can_frame` or `canfd_frame` (linux/can.h); None where it is neither. Never raises."""
    if len(raw) == _CLASSICAL_BYTES:
        can_id, length, data = _CLASSICAL.unpack(raw)
        is_fd = False
    elif len(raw) == _FD_BYTES:
        can_id, length, _, data = _FD.unpack(raw)
        is_fd = True
    else:
        return None
    is_error, is_extended = bool(can_id & ERR_FLAG), bool(can_id & EFF_FLAG)
    return Frame(
        can_id & (0x1FFF_FFFF if is_extended or is_error else 0x7FF),
        b"" if can_id & RTR_FLAG else data[: min(length, len(data))],
        received_ns,
        wall_ns,
        is_error=is_error,
        is_fd=is_fd,
        is_extended=is_extended,
        hardware_ns=hardware_ns,
        is_remote=bool(can_id & RTR_FLAG),
    )


def pack_can_frame(frame: Frame) -> bytes:
    """The frame as the kernel wants it."""
    can_id = frame.can_id | (EFF_FLAG if frame.is_extended else 0) | (RTR_FLAG if frame.is_remote else 0)
    if frame.is_fd:
        return _FD.pack(can_id, len(frame.data), _FD_SWITCH, frame.data)
    return _CLASSICAL.pack(can_id, len(frame.data), frame.data)


class SocketCanBackend:
    """One interface. The socket outlives link down and up; it is opened anew after the interface itself was gone."""

    def __init__(self, interface: str) -> None:
        """Open and bind. Raises BusUnavailable where the kernel has no CAN or no such interface."""
        self.interface = interface
        self.overflowed = 0
        info = read_link(interface)
        self.is_physical = info is None or not info.is_virtual
        self._socket = self._open()

    def _open(self) -> socket.socket:
        if not interface_exists(self.interface):
            raise BusUnavailable(
                f"bus {self.interface}: no such network interface; `ip link` lists them, `hilsim:demo` needs none"
            )
        try:
            can = socket.socket(_AF_CAN, socket.SOCK_RAW, _CAN_RAW)
        except OSError as error:
            raise BusUnavailable(
                f"bus {self.interface}: this kernel has no CAN ({error.strerror}); "
                "try `modprobe can_raw`, or --bus hilsim:demo"
            ) from error
        try:
            can.setblocking(False)
            can.setsockopt(_SOL_CAN_RAW, _RAW_ERR_FILTER, _ERR_MASK)
            can.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
            can.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPING, _STAMP_FLAGS)
            _enlarge(can)
            if read_mtu(self.interface) == _FD_BYTES:
                can.setsockopt(_SOL_CAN_RAW, _RAW_FD_FRAMES, 1)
            can.bind((self.interface,))
        except OSError as error:
            can.close()
            raise BusUnavailable(
                f"bus {self.interface}: {error.strerror}; is it a CAN interface? "
                f"`ip -details link show {self.interface}` tells"
            ) from error
        return can

    def fileno(self) -> int:
        """The socket's descriptor."""
        return self._socket.fileno()

    def read(self) -> Frame | None:
        """One frame or None. Raises LinkDown."""
        while True:
            try:
                raw, ancillary, _, _ = self._socket.recvmsg(_FD_BYTES, _ANCILLARY_BYTES)
            except (BlockingIOError, InterruptedError):
                return None
            except OSError as error:
                raise LinkDown(error.strerror or "link down", reopen=error.errno != errno.ENETDOWN) from error
            frame = self._frame(raw, ancillary)
            if frame is not None:
                return frame

    def _frame(self, raw: bytes, ancillary: list[tuple[int, int, bytes]]) -> Frame | None:
        now_ns, wall_now_ns = time.monotonic_ns(), time.time_ns()
        wall_ns = hardware_ns = 0
        for level, kind, payload in ancillary:
            if level != socket.SOL_SOCKET:
                continue
            if kind == _SO_RXQ_OVFL and len(payload) >= 4:
                self.overflowed = struct.unpack_from("=I", payload)[0]
            elif kind == _SO_TIMESTAMPING and len(payload) >= _STAMPS.size:
                stamp = _STAMPS.unpack_from(payload)
                wall_ns = stamp[0] * 1_000_000_000 + stamp[1]
                hardware_ns = stamp[4] * 1_000_000_000 + stamp[5]
        age_ns = wall_now_ns - wall_ns
        if not 0 <= age_ns < _WALL_STEP_NS:
            wall_ns, age_ns = wall_now_ns, 0
        return parse_can_frame(raw, now_ns - age_ns, wall_ns, hardware_ns)

    def write(self, frame: Frame) -> WriteResult:
        """Hand a frame to the kernel without waiting."""
        try:
            self._socket.send(pack_can_frame(frame))
        except OSError as error:
            if error.errno in _FULL:
                return WriteResult.FULL
            return WriteResult.DOWN if error.errno in _LINK_LOST else WriteResult.REFUSED
        return WriteResult.SENT

    def is_up(self) -> bool:
        """Whether the link is up now."""
        info = read_link(self.interface)
        return info is not None and info.is_up

    def info(self) -> LinkInfo | None:
        """Bit rates, controller state and error counters, as far as the kernel has them."""
        return read_link(self.interface)

    def reopen(self) -> None:
        """Open a new socket, for an interface that was gone. Raises BusUnavailable."""
        self._socket.close()
        self._socket = self._open()
        self.overflowed = 0

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _enlarge(can: socket.socket) -> None:
    """As large a receive buffer as this process may have; root may exceed the system's limit."""
    try:
        can.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _RECEIVE_BUFFER_BYTES)
    except OSError:
        can.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)


def read_mtu(interface: str) -> int:
    """The interface's MTU: 16 for classical CAN, 72 for CAN FD; 0 where it cannot be read."""
    try:
        with open(f"/sys/class/net/{interface}/mtu", encoding="ascii") as file:  # noqa: PTH123 - a kernel file
            return int(file.read())
    except (OSError, ValueError):
        return 0
