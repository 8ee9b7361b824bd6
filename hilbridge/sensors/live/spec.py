"""What `--gaze` may say for a live eye tracker: neon:[HOST[:PORT]], lsl:STREAM, udp:[HOST:]PORT."""

from __future__ import annotations

from hilbridge.errors import InputError
from hilbridge.sensors.live.base import LiveGaze
from hilbridge.sensors.live.lsl import LslChannels, LslGaze
from hilbridge.sensors.live.neon import NeonGaze
from hilbridge.sensors.live.udp import UdpGaze

_KINDS = ("neon", "lsl", "udp")


def is_live(spec: str) -> bool:
    """Whether it names an eye tracker and no recording."""
    kind, colon, _ = spec.partition(":")
    return bool(colon) and kind in _KINDS


def open_live_gaze(spec: str, channels: LslChannels, latency_ns: int) -> LiveGaze:
    """The eye tracker that a spec names, found but not started. Raises InputError."""
    kind, _, rest = spec.partition(":")
    if kind == "neon":
        return NeonGaze(rest)
    if kind == "lsl":
        return LslGaze(rest, channels)
    host, _, port = rest.rpartition(":")
    if not port.isdigit() or not 0 < int(port) < 65_536:
        raise InputError(f"gaze {spec}: {port!r} is no port; write udp:PORT (this computer only) or udp:0.0.0.0:PORT")
    return UdpGaze(int(port), host or "127.0.0.1", latency_ns=latency_ns)
