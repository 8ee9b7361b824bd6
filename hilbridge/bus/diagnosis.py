"""Diagnoses a bus from a few seconds of listening: the rules behind `hilbridge doctor --bus can0`.

`observe` listens (it sends nothing), `diagnose` decides, without I/O. The signs are those that Linux drivers report: state,
counters and bit rates over netlink, and error frames (`ip link set can0 type can berr-reporting on` makes them tell
more, yet none of the rules needs it).
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from hilbridge.bus.model.error_frames import CLASS_BUS_ERROR, CLASS_PROTOCOL, ErrorState, read_error_frame
from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.netlink import LinkInfo, read_link
from hilbridge.records import Frame
from hilbridge.wire.dbc_file import dbc_number, load_dbc, shown_number

_COUNTER_BYTE = 2  # of an E2E profile 5 header
_TWICE = 0.7  # a cycle this much shorter than it should be is no jitter
_ENOUGH = 8  # frames of one identifier that a judgement of its cycle needs


class Severity(StrEnum):
    """WELL, or NOTE (works, but worth knowing), or ILL."""

    WELL = "well"
    NOTE = "note"
    ILL = "ill"


class BusFinding(NamedTuple):
    """One thing seen. `cure` is the command or act that mends it; empty where nothing is to mend."""

    subject: str
    severity: Severity
    text: str
    cure: str = ""


@dataclass(frozen=True, slots=True)
class Known:
    """A message of the DBC: its name, who sends it, its cycle (0: an event)."""

    name: str
    sender: str
    cycle_ms: float


@dataclass(frozen=True, slots=True)
class Observation:
    """Some seconds of one bus. `link` is what the kernel says at the end (None: it has nothing to say)."""

    spec: str
    seconds: float
    frames: tuple[Frame, ...]
    link: LinkInfo | None = None
    interface: str | None = None
    link_up: bool = True
    lost: int = 0

    @property
    def good(self) -> list[Frame]:
        """Data and remote frames."""
        return [frame for frame in self.frames if not frame.is_error]

    @property
    def errors(self) -> list[Frame]:
        """Error frames."""
        return [frame for frame in self.frames if frame.is_error]


def known_messages(path: Path) -> dict[int, Known]:
    """The messages of a DBC by its number (an extended identifier has bit 31 set); one with several senders (STOP)
    belongs to nobody. Raises InputError.
    """
    return {
        dbc_number(message.frame_id, is_extended=message.is_extended_frame): Known(
            message.name, message.senders[0] if len(message.senders) == 1 else "", float(message.cycle_time or 0)
        )
        for message in load_dbc(path).messages
    }


async def observe(spec: str, seconds: float, **options: Any) -> Observation:
    """Listen to a bus without sending. Raises BusUnavailable."""
    frames: list[Frame] = []
    begin = time.monotonic()
    async with BusPort.open(spec, listen_only=True, **options) as port:
        try:
            async with asyncio.timeout(seconds):
                while True:
                    frames.append(await port.receive())
        except TimeoutError:
            pass
        return observation_of(port, frames, time.monotonic() - begin)


def observation_of(port: BusPort, frames: Sequence[Frame], seconds: float) -> Observation:
    """What an open port has heard, and what the kernel says of its interface now."""
    interface = port.spec.channel if port.spec.interface == "socketcan" else None
    link = read_link(interface) if interface else None
    link_up = port.state.link_up if link is None else link.is_up
    lost = port.counters.overflow_kernel + port.counters.overflow_port
    return Observation(str(port.spec), seconds, tuple(frames), link, interface, link_up, lost)


def diagnose(
    seen: Observation, known: Mapping[int, Known], *, bitrate: int = 500_000, ours: str = "BRIDGE"
) -> list[BusFinding]:
    """What is well and what is not; `ours` names the node that this computer is, and that must not be heard yet."""
    findings = _link(seen, bitrate)
    if not seen.link_up:
        return findings
    findings += _controller(seen)
    findings += _traffic(seen, bitrate)
    findings += _identifiers(seen, known, ours)
    return findings


def _up(interface: str | None, bitrate: int) -> str:
    name = interface or "can0"
    return f"sudo ip link set {name} up type can bitrate {bitrate} restart-ms 100"


def _link(seen: Observation, bitrate: int) -> list[BusFinding]:
    link = seen.link
    if not seen.link_up:
        return [BusFinding("bus link", Severity.ILL, f"{seen.spec} is down", _up(seen.interface, bitrate))]
    if link is None:
        return [BusFinding("bus link", Severity.WELL, f"{seen.spec} is open")]
    if link.is_virtual:
        return [
            BusFinding("bus link", Severity.WELL, f"{seen.spec} is up, virtual ({link.kind}): no wire, no bit rate")
        ]
    findings = []
    if link.bitrate is None:
        findings.append(BusFinding("bus link", Severity.WELL, f"{seen.spec} is up; its driver tells no bit rate"))
    elif link.bitrate != bitrate:
        cure = f"sudo ip link set {link.name} down && {_up(link.name, bitrate)}"
        text = f"{seen.spec} is set to {link.bitrate} bit/s, the DBC says {bitrate}"
        findings.append(BusFinding("bit rate", Severity.ILL, text, cure))
    else:
        findings.append(BusFinding("bus link", Severity.WELL, f"{seen.spec} is up at {link.bitrate} bit/s"))
    if link.listen_only:
        text = "the interface is in listen-only mode: it acknowledges nothing and can send nothing"
        cure = f"before arming: sudo ip link set {link.name} down && sudo ip link set {link.name} up type can listen-only off"
        findings.append(BusFinding("bus mode", Severity.NOTE, text, cure))
    if link.restart_ms == 0:
        cure = f"sudo ip link set {link.name} type can restart-ms 100 (while it is down)"
        findings.append(BusFinding("bus-off recovery", Severity.NOTE, "after bus-off it stays off the bus", cure))
    return findings


def _state(seen: Observation) -> ErrorState:
    """The controller's state: what the kernel says, else what the last error frame said."""
    if seen.link is not None and seen.link.state is not None:
        if seen.link.state in list(ErrorState):
            return ErrorState(seen.link.state)
        return ErrorState.UNKNOWN
    told = [read_error_frame(frame.can_id, frame.data).controller for frame in seen.errors]
    return next((state for state in reversed(told) if state is not None), ErrorState.UNKNOWN)


def _controller(seen: Observation) -> list[BusFinding]:
    state, link = _state(seen), seen.link
    counters = "" if link is None or link.tx_errors is None else f" (TEC {link.tx_errors}, REC {link.rx_errors})"
    was_off = any(read_error_frame(frame.can_id, frame.data).controller is ErrorState.BUS_OFF for frame in seen.errors)
    if state is ErrorState.BUS_OFF or was_off:
        name = seen.interface or seen.spec
        text = f"the controller {'is' if state is ErrorState.BUS_OFF else 'was'} bus-off{counters}: what it sent failed"
        cure = f"check bit rate, wires and termination, then: sudo ip link set {name} type can restart"
        return [BusFinding("controller", Severity.ILL, text, cure)]
    if state in (ErrorState.PASSIVE, ErrorState.WARNING):
        return [
            BusFinding("controller", Severity.NOTE, f"{state}{counters}: many errors lately", "see the findings below")
        ]
    return []


def _traffic(seen: Observation, bitrate: int) -> list[BusFinding]:
    """Wrong bit rate, termination, nobody there: told apart by what is heard besides the errors."""
    good, errors = seen.good, seen.errors
    events = [read_error_frame(frame.can_id, frame.data) for frame in errors]
    broken = sum(bool(frame.can_id & (CLASS_PROTOCOL | CLASS_BUS_ERROR)) for frame in errors)
    unacknowledged = sum(event.no_ack for event in events)
    passive = _state(seen) in (ErrorState.PASSIVE, ErrorState.BUS_OFF)
    receive_errors = (seen.link.rx_errors or 0) if seen.link is not None else 0
    heard = f"{len(good)} frames in {seen.seconds:.1f} s"
    if unacknowledged and not good:
        text = f"nobody acknowledges ({unacknowledged} times) and nothing is heard: this is the only node that works"
        return [BusFinding("traffic", Severity.ILL, text, "switch the device on; check CAN_H, CAN_L and ground")]
    if not good and (broken - unacknowledged > 0 or passive or receive_errors >= 96):
        rates = ", ".join(str(rate) for rate in (125_000, 250_000, 500_000, 1_000_000) if rate != bitrate)
        text = f"something is sent, but no frame can be read ({len(errors)} error frames): the others run at another bit rate"
        cure = f"set the rate of the device's manual; usual ones are {rates}: {_up(seen.interface, bitrate)}"
        return [BusFinding("bit rate", Severity.ILL, text, cure)]
    if good and broken > max(2, len(good) // 1000):
        share = broken / (broken + len(good))
        text = (
            f"{heard}, yet {broken} were destroyed ({share:.1%}): a sign of missing termination, a bad cable or noise"
        )
        cure = "power off and measure CAN_H to CAN_L: 60 ohm is right, 120 lacks one terminator (`hilbridge docs real-bus`)"
        return [BusFinding("termination", Severity.ILL if share > 0.05 else Severity.NOTE, text, cure)]
    if not good:
        text = f"nothing heard in {seen.seconds:.1f} s, no errors either"
        return [
            BusFinding("traffic", Severity.NOTE, text, "is the device on and connected? then its status comes at 50 Hz")
        ]
    findings = [BusFinding("traffic", Severity.WELL, heard)]
    if seen.lost:
        text = f"{seen.lost} frames were lost before they could be read"
        findings.append(BusFinding("receive buffer", Severity.NOTE, text, "sudo sysctl -w net.core.rmem_max=8388608"))
    return findings


def _identifiers(seen: Observation, known: Mapping[int, Known], ours: str) -> list[BusFinding]:
    by_id: dict[int, list[Frame]] = {}
    for frame in seen.good:
        by_id.setdefault(dbc_number(frame.can_id, is_extended=frame.is_extended), []).append(frame)
    findings = []
    impostors = sorted(known[can_id].name for can_id in by_id if can_id in known and known[can_id].sender == ours)
    if impostors:
        text = f"another node sends what only this one may: {', '.join(impostors)}"
        findings.append(
            BusFinding("identifiers", Severity.ILL, text, "stop the other bridge, or change its identifiers")
        )
    for can_id, frames in sorted(by_id.items()):
        message = known.get(can_id)
        if message is not None and message.sender != ours and _two_senders(frames, message.cycle_ms):
            text = f"{message.name} ({shown_number(can_id)}) comes from two nodes: too often, and its counter jumps to and fro"
            findings.append(BusFinding("identifiers", Severity.ILL, text, "take one of the two devices off the bus"))
    strangers = sorted(can_id for can_id in by_id if can_id not in known)
    if strangers:
        shown = ", ".join(shown_number(can_id) for can_id in strangers[:6]) + (" ..." if len(strangers) > 6 else "")
        text = f"{len(strangers)} identifiers that the DBC does not have: {shown}"
        cure = "nothing, if they are meant to be there; those below 0x060 can delay ACT_CMD (hilbridge bus-analysis)"
        findings.append(BusFinding("identifiers", Severity.NOTE, text, cure))
    return findings


def _two_senders(frames: Sequence[Frame], cycle_ms: float) -> bool:
    """Whether a cyclic message has two sources: it comes clearly too often and its E2E counter is not one sequence."""
    if cycle_ms <= 0 or len(frames) < _ENOUGH:
        return False
    span_ms = (frames[-1].received_ns - frames[0].received_ns) / 1e6
    too_often = span_ms / (len(frames) - 1) < _TWICE * cycle_ms
    counters = [frame.data[_COUNTER_BYTE] for frame in frames if len(frame.data) > _COUNTER_BYTE]
    steps = [(after - before) % 256 for before, after in pairwise(counters)]
    jumps = sum(not 1 <= step <= 8 for step in steps)
    return too_often and jumps > len(steps) // 4
