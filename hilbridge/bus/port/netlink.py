"""What Linux says of a CAN interface over rtnetlink: kind, link, bit rates, controller state, error counters.

python-can ignores `bitrate=` on socketcan and cannot ask for any of this; the kernel can (linux/can/netlink.h).
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from dataclasses import dataclass

_RTM_GETLINK, _NLMSG_ERROR = 18, 2
_NLM_F_REQUEST = 1
_NLMSG = struct.Struct("=IHHII")
_IFINFO = struct.Struct("=BxHiII")
_ATTRIBUTE = struct.Struct("=HH")
_IFLA_IFNAME, _IFLA_TXQLEN, _IFLA_OPERSTATE, _IFLA_LINKINFO = 3, 13, 16, 18
_IFLA_INFO_KIND, _IFLA_INFO_DATA = 1, 2
_IFLA_CAN_BITTIMING, _IFLA_CAN_STATE, _IFLA_CAN_CTRLMODE = 1, 4, 5
_IFLA_CAN_RESTART_MS, _IFLA_CAN_BERR, _IFLA_CAN_DATA_BITTIMING = 6, 8, 9
_CTRLMODE_LISTEN_ONLY, _CTRLMODE_FD = 0x02, 0x20
_IFF_UP = 1
_ATTRIBUTE_TYPE_MASK = 0x3FFF  # the two top bits say nested and byte order
_CAN_STATES = ("error-active", "error-warning", "error-passive", "bus-off", "stopped", "sleeping")
VIRTUAL_KINDS = frozenset({"vcan", "vxcan"})


@dataclass(frozen=True, slots=True)
class LinkInfo:
    """One interface as the kernel has it; None where it has nothing to say (vcan has no bit rate and no state)."""

    name: str
    kind: str
    is_up: bool
    tx_queue_length: int | None = None
    bitrate: int | None = None
    data_bitrate: int | None = None
    state: str | None = None
    tx_errors: int | None = None
    rx_errors: int | None = None
    listen_only: bool = False
    is_fd: bool = False
    restart_ms: int | None = None

    @property
    def is_virtual(self) -> bool:
        """Whether frames stay in the kernel. An unknown kind counts as a wire: that is the careful side."""
        return self.kind in VIRTUAL_KINDS


def _attributes(raw: bytes) -> Iterator[tuple[int, bytes]]:
    """Type and payload of each attribute; stops at the first one that is cut short."""
    offset = 0
    while offset + _ATTRIBUTE.size <= len(raw):
        length, kind = _ATTRIBUTE.unpack_from(raw, offset)
        if length < _ATTRIBUTE.size or offset + length > len(raw):
            return
        yield kind & _ATTRIBUTE_TYPE_MASK, raw[offset + _ATTRIBUTE.size : offset + length]
        offset += (length + 3) & ~3


def _u32(raw: bytes, index: int = 0) -> int | None:
    return struct.unpack_from("=I", raw, 4 * index)[0] if len(raw) >= 4 * index + 4 else None


def request(interface: str) -> bytes:
    """The RTM_GETLINK message that asks for one interface by name."""
    name = interface.encode() + b"\0"
    attribute = _ATTRIBUTE.pack(_ATTRIBUTE.size + len(name), _IFLA_IFNAME) + name
    attribute += b"\0" * (-len(attribute) % 4)
    body = _IFINFO.pack(socket.AF_UNSPEC, 0, 0, 0, 0) + attribute
    return _NLMSG.pack(_NLMSG.size + len(body), _RTM_GETLINK, _NLM_F_REQUEST, 1, 0) + body


def parse_link(raw: bytes) -> LinkInfo | None:
    """Read the kernel's answer to `request`; None where it is an error or no answer at all. Never raises."""
    if len(raw) < _NLMSG.size + _IFINFO.size:
        return None
    _, message_type, _, _, _ = _NLMSG.unpack_from(raw)
    if message_type == _NLMSG_ERROR:
        return None
    _, _, _, flags, _ = _IFINFO.unpack_from(raw, _NLMSG.size)
    name, kind, queue_length, data = "", "", None, b""
    for attribute, payload in _attributes(raw[_NLMSG.size + _IFINFO.size :]):
        if attribute == _IFLA_IFNAME:
            name = payload.rstrip(b"\0").decode(errors="replace")
        elif attribute == _IFLA_TXQLEN:
            queue_length = _u32(payload)
        elif attribute == _IFLA_LINKINFO:
            nested = dict(_attributes(payload))
            kind = nested.get(_IFLA_INFO_KIND, b"").rstrip(b"\0").decode(errors="replace")
            data = nested.get(_IFLA_INFO_DATA, b"")
    return _with_can_data(name, kind, bool(flags & _IFF_UP), queue_length, dict(_attributes(data)))


def _with_can_data(name: str, kind: str, is_up: bool, queue_length: int | None, can: dict[int, bytes]) -> LinkInfo:
    state = _u32(can.get(_IFLA_CAN_STATE, b""))
    modes = _u32(can.get(_IFLA_CAN_CTRLMODE, b""), 1) or 0
    berr = can.get(_IFLA_CAN_BERR, b"")
    tx_errors, rx_errors = struct.unpack_from("=HH", berr) if len(berr) >= 4 else (None, None)
    return LinkInfo(
        name=name,
        kind=kind,
        is_up=is_up,
        tx_queue_length=queue_length,
        bitrate=_u32(can.get(_IFLA_CAN_BITTIMING, b"")),
        data_bitrate=_u32(can.get(_IFLA_CAN_DATA_BITTIMING, b"")) or None,
        state=_CAN_STATES[state] if state is not None and state < len(_CAN_STATES) else None,
        tx_errors=tx_errors,
        rx_errors=rx_errors,
        listen_only=bool(modes & _CTRLMODE_LISTEN_ONLY),
        is_fd=bool(modes & _CTRLMODE_FD),
        restart_ms=_u32(can.get(_IFLA_CAN_RESTART_MS, b"")),
    )


def read_link(interface: str) -> LinkInfo | None:
    """Ask the kernel; None where there is no such interface or no netlink (not Linux)."""
    family = getattr(socket, "AF_NETLINK", None)
    if family is None:
        return None
    try:
        with socket.socket(family, socket.SOCK_RAW, 0) as netlink:
            netlink.settimeout(1.0)
            netlink.bind((0, 0))
            netlink.send(request(interface))
            return parse_link(netlink.recv(65536))
    except OSError:
        return None
