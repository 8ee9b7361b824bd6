"""What `--bus` may say, and the errors of opening it: one line that names the bus and the cure."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

from hilbridge.errors import InputError

DEFAULT_NAME = "hilbridge"
# python-can interfaces that reach no wire. A socketcan interface is judged by its kernel kind instead.
_VIRTUAL_INTERFACES = frozenset({"hilsim", "virtual"})
_GIVES_BACK = frozenset({"udp_multicast"})


class BusUnavailable(InputError):
    """The bus cannot be opened; the message is one line with the cure."""


class BusSpec(NamedTuple):
    """A python-can interface name and its channel."""

    interface: str
    channel: str

    @property
    def is_simulated(self) -> bool:
        """Whether it surely reaches no wire (a socketcan channel may or may not)."""
        return self.interface in _VIRTUAL_INTERFACES

    def __str__(self) -> str:
        """As the user may write it again."""
        return self.channel if self.interface == "socketcan" else f"{self.interface}:{self.channel}"


def interface_exists(name: str) -> bool:
    """Whether the kernel has a network interface of this name (Linux only)."""
    return sys.platform == "linux" and "/" not in name and bool(name) and Path("/sys/class/net", name).exists()


def parse_spec(text: str) -> BusSpec:
    """Read `auto`, `vcan0`, `can0`, `hilsim:NAME` or any python-can `interface:channel`. Raises BusUnavailable.

    `auto` is `vcan0` where the kernel has it, otherwise the simulated bus.
    """
    if text == "auto":
        vcan = interface_exists("vcan0")
        return BusSpec("socketcan", "vcan0") if vcan else BusSpec("hilsim", DEFAULT_NAME)
    interface, colon, channel = text.partition(":")
    if not colon:
        interface, channel = "socketcan", text
    if not interface or not channel:
        raise BusUnavailable(
            f"bus {text!r}: write auto, a CAN interface such as can0, or interface:channel such as hilsim:demo"
        )
    if interface in _GIVES_BACK:
        raise BusUnavailable(
            f"bus {text}: {interface} gives a node its own frames back, which the protocol takes for a second node; "
            "use hilsim:NAME, which needs no hardware"
        )
    return BusSpec(interface, channel)
