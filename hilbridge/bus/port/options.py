"""What a user may hand on to an interface: `--bus-option KEY=VALUE` and `[bus.options]`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hilbridge.bus.port.spec import BusSpec, BusUnavailable

_SIMULATED = ("bitrate", "data_bitrate")
_NOT_HERE = {
    "interface": "--bus INTERFACE:CHANNEL names it",
    "channel": "--bus INTERFACE:CHANNEL names it",
    # Its own frames look like another bridge's, and the device latches.
    "receive_own_messages": "a node must not hear itself",
}


def checked_options(spec: BusSpec, options: Mapping[str, Any]) -> dict[str, Any]:
    """The options that go to the interface of a bus. Raises BusUnavailable for one that would be ignored or do harm."""
    for key in options:
        if key in _NOT_HERE:
            raise BusUnavailable(f"bus {spec}: option {key} cannot be set; {_NOT_HERE[key]}")
        if spec.interface == "socketcan":
            raise BusUnavailable(
                f"bus {spec}: option {key} would be ignored, a SocketCAN interface is set up in the kernel; "
                f"`ip link set {spec.channel} type can ...` (docs/real-bus.md)"
            )
        if spec.interface == "hilsim" and key not in _SIMULATED:
            raise BusUnavailable(f"bus {spec}: no option {key}; the simulated bus knows {', '.join(_SIMULATED)}")
        if spec.interface == "hilsim" and type(options[key]) is not int:
            raise BusUnavailable(f"bus {spec}: option {key} = {options[key]!r} is no whole number; write {key}=500000")
    return dict(options)
