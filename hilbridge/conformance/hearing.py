"""What a tester hears: the device's messages as checked by the bridge's own decoder, and what follows from them."""

from __future__ import annotations

from hilbridge.conformance.findings import Heard
from hilbridge.records import Frame
from hilbridge.wire.codec import Codec, Decoded, RejectReason
from hilbridge.wire.link import WireLink

STOPPED = ("Latched", "EStop")


class Hearing:
    """Every accepted message in order, and the newest of each kind."""

    def __init__(self, codec: Codec) -> None:
        self.wire = WireLink(codec)
        self.log: list[Heard] = []
        self.newest: dict[str, Heard] = {}
        self.diag: dict[str, tuple[int, int]] = {}
        self.unsound: list[str] = []
        self.strangers: set[str] = set()

    def take(self, frame: Frame) -> None:
        """One frame of the bus."""
        if frame.is_error:
            return
        message = self.wire.decode(frame)
        if not isinstance(message, Decoded):
            shown = message.name or f"0x{frame.can_id:03X}"
            if message.reason is RejectReason.UNKNOWN_ID:
                self.strangers.add(shown)
            else:
                self.unsound.append(f"{shown} {message.reason.value}")
            return
        heard = Heard(frame.received_ns, message.name, message.signals, message.counter)
        self.log.append(heard)
        self.newest[message.name] = heard
        if message.name == "CTRL_DIAG":
            index = str(message.signals["Index"])
            self.diag[index] = (heard.at_ns, int(message.signals[index]))

    def since(self, at_ns: int) -> list[Heard]:
        """What arrived from then on, oldest first."""
        found = []
        for heard in reversed(self.log):
            if heard.at_ns < at_ns:
                break
            found.append(heard)
        return found[::-1]

    @property
    def state(self) -> str:
        """The device's state as last told; empty before it told any."""
        status = self.newest.get("CTRL_STATUS")
        return "" if status is None else str(status.signals["State"])

    @property
    def reason(self) -> str:
        """Its reason as last told."""
        status = self.newest.get("CTRL_STATUS")
        return "" if status is None else str(status.signals["Reason"])

    @property
    def session(self) -> int:
        """The session that the device says it has; 0 for none."""
        status = self.newest.get("CTRL_STATUS")
        return int(status.signals["Session"]) if status is not None and status.signals["Armed"] else 0

    @property
    def assist_zero(self) -> bool:
        """Whether the last status says that assist is exactly zero."""
        status = self.newest.get("CTRL_STATUS")
        return status is not None and bool(status.signals["AssistZero"])

    @property
    def stopped(self) -> bool:
        """Latched, or in ESTOP."""
        return self.state in STOPPED

    @property
    def at_rest(self) -> bool:
        """Neither assist nor gravity support."""
        meas = self.newest.get("CTRL_MEAS")
        return self.assist_zero and meas is not None and meas.signals["GravityTorque"] == 0


def shows_assist(heard: Heard) -> bool:
    """Whether this message says that there is assist torque."""
    if heard.name == "CTRL_STATUS":
        return not heard.signals["AssistZero"]
    return heard.name == "CTRL_MEAS" and heard.signals["AssistTorque"] != 0
