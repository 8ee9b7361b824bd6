"""What may be said for a live device: neon:[HOST[:PORT]], lsl:STREAM, udp:[HOST:]PORT; for gaze, a class of one's own."""

from __future__ import annotations

from hilbridge.errors import InputError
from hilbridge.sensors.live import plugins
from hilbridge.sensors.live.base import LiveBody, LiveDevice, LiveGaze
from hilbridge.sensors.live.lsl import LslBody, LslChannels, LslGaze
from hilbridge.sensors.live.neon import NeonGaze
from hilbridge.sensors.live.udp import UdpBody, UdpGaze

_KINDS = ("neon", "lsl", "udp")


def is_live(spec: str) -> bool:
    """Whether it names a device and no recording."""
    kind, colon, _ = spec.partition(":")
    return (bool(colon) and kind in _KINDS) or plugins.is_own(spec)


def open_live_gaze(spec: str, channels: LslChannels, latency_ns: int) -> LiveGaze:
    """The eye tracker that a spec names, found but not started. Raises InputError."""
    kind, _, rest = spec.partition(":")
    if kind == "neon":
        return NeonGaze(rest)
    if kind == "lsl":
        return LslGaze(rest, channels)
    if kind not in _KINDS:
        tracker: LiveGaze = plugins.called("gaze", spec, LiveDevice)
        return tracker
    port, host = _port(f"gaze {spec}", rest)
    return UdpGaze(port, host, latency_ns=latency_ns)


def open_live_body(what: str, spec: str, default: str) -> LiveBody:
    """Sensors on the body that a spec names (`what`: inertial, skeleton), found but not started. Raises InputError.

    default: what a sensor is called that its sender does not name.
    """
    kind, _, rest = spec.partition(":")
    if kind not in _KINDS:
        raise InputError(
            f"{what} {spec}: code of one's own is for gaze; give lsl:STREAM, udp:PORT or a recording's folder"
        )
    if kind == "neon":
        raise InputError(f"{what} {spec}: an eye tracker; give lsl:STREAM, udp:PORT or a recording's folder")
    if kind == "lsl":
        return LslBody(what, rest, default)
    port, host = _port(f"{what} {spec}", rest)
    return UdpBody(what, port, host, default)


def _port(name: str, rest: str) -> tuple[int, str]:
    host, _, port = rest.rpartition(":")
    if not port.isdigit() or not 0 < int(port) < 65_536:
        raise InputError(f"{name}: {port!r} is no port; write udp:PORT (this computer only) or udp:0.0.0.0:PORT")
    return int(port), host or "127.0.0.1"
