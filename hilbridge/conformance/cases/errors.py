"""Frames that are wrong, repeated, forged or old: dropped, counted, and no food for a deadline."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from hilbridge.conformance.cases.case import Case, Run, risen, stays
from hilbridge.conformance.findings import demand
from hilbridge.conformance.tester import HOLD, SILENT, VERB, ByHand
from hilbridge.records import Frame

_UNASSISTED = ("Follow", "Ready", "RampDown")


class Fault(NamedTuple):
    """How a good frame is made a bad one, and which counter has to see it."""

    what: str
    counter: str
    make: Callable[[ByHand, Frame], Frame]


def _bad_crc(tester: ByHand, frame: Frame) -> Frame:
    del tester
    return frame._replace(data=bytes((frame.data[0] ^ 1, *frame.data[1:])))


def _short(tester: ByHand, frame: Frame) -> Frame:
    del tester
    return frame._replace(data=frame.data[:7])


def _repeated(tester: ByHand, frame: Frame) -> Frame:
    del frame
    return next(one for one in reversed(tester.sent) if one.can_id == tester.codec.messages["ACT_CMD"].can_id)


def _jumping(tester: ByHand, frame: Frame) -> Frame:
    """Half a round further each time."""
    del frame
    tester.skipped = (tester.skipped + 90) & 0xFF
    return tester.frame("ACT_CMD", _hold_signals(tester), tester.skipped)


def _hold_signals(tester: ByHand) -> dict[str, int | float | str]:
    status = tester.hearing.newest["CTRL_STATUS"]
    return {"Gate": "Hold", "Verb": "None", "Session": tester.session, "Echo": status.counter, "SensingAge": 20}


def _feeds_nothing(fault: Fault) -> Run:
    """HOLDs that are all bad: the command deadline has to run out as in silence, and each has to be counted."""

    def run(tester: ByHand) -> str:
        tester.anew()
        tester.to_ready()
        before = tester.counts(fault.counter)
        tester.skipped = 0
        bad: list[int] = []

        def spoil(frame: Frame) -> list[Frame]:
            bad.append(1)
            return [fault.make(tester, frame)]

        tester.alter = spoil
        left = tester.until(lambda: tester.hearing.state != "Ready", 160.0 + tester.setting.margin_ms)
        reason = tester.hearing.reason
        tester.wish = SILENT
        tester.run(30.0)
        after = tester.counts(fault.counter)
        demand(left, f"still Ready after {len(bad)} HOLDs with {fault.what}: they feed the command deadline")
        risen(before, after, fault.counter, len(bad), f"{len(bad)} HOLDs with {fault.what}")
        return f"{len(bad)} dropped and counted; {reason}"

    return run


def _forged(tester: ByHand) -> str:
    """An ACT with a MAC of another key."""
    tester.anew()
    tester.to_ready()
    before = tester.counts("MacFailures", "RejMac")
    tester.wish = SILENT
    command = tester.command(VERB)
    tester.send(command, tester.authorisation(command, flip=1))
    stays(tester, _UNASSISTED, 40.0, "an ACT with a wrong MAC")
    tester.wish = HOLD
    after = tester.counts("MacFailures", "RejMac")
    for name in before:
        risen(before, after, name, 1, "one ACT with a wrong MAC")
    return "refused and counted"


def _altered(tester: ByHand) -> str:
    """A right ACT_AUTH, for a command that was altered on its way and given a right CRC."""
    tester.anew()
    tester.to_ready()
    tester.wish = SILENT
    command = tester.command(VERB)
    authorisation = tester.authorisation(command)
    number = command.data[2]
    altered = tester.frame("ACT_CMD", {**_hold_signals(tester), "Gate": "Act", "Verb": "Cut"}, number)
    tester.send(altered, authorisation)
    stays(tester, _UNASSISTED, 40.0, "an ACT that was altered on its way")
    return "refused"


def _replayed_pair(tester: ByHand) -> str:
    """A pair that was accepted, once more: with its own counters, then with new ones and right CRCs."""
    tester.anew()
    tester.to_assist()
    tester.wish = SILENT
    tester.act()
    old = tester.sent[-2:]
    tester.wish = HOLD
    tester.run(120.0)
    tester.to_ready()
    tester.wish = SILENT
    tester.send(*old)
    stays(tester, _UNASSISTED, 40.0, "a replayed pair")
    for frame in old:
        name = tester.codec.by_id[frame.can_id].name
        decoded = tester.codec.read(tester.codec.messages[name], frame)
        tester.send(tester.frame(name, decoded.signals))  # type: ignore[union-attr]
    stays(tester, _UNASSISTED, 40.0, "a replayed pair with new counters")
    return "refused, twice"


def _queue(tester: ByHand) -> str:
    """Everything that was sent in half a second of assisting, at once and a second later."""
    tester.anew()
    tester.to_assist()
    first = len(tester.sent)
    tester.run(500.0)
    stale = tester.sent[first:]
    tester.wish = HOLD
    tester.run(500.0)
    tester.to_ready()
    tester.wish = SILENT
    tester.beats = False
    for frame in stale:
        tester.send(frame)
        tester.run(0.3)
    stays(tester, _UNASSISTED, 60.0, f"{len(stale)} frames of a second ago")
    return f"{len(stale)} stale frames, no assist"


def _unknown(tester: ByHand) -> str:
    """Identifiers that are nobody's change nothing."""
    tester.to_ready()
    before = tester.counts("RejUnknownId")
    tester.send(*(Frame(can_id, bytes(8)) for can_id in (0x002, 0x3FF, 0x7FF)))
    stays(tester, ("Ready",), 80.0, "identifiers that are nobody's")
    risen(before, tester.counts("RejUnknownId"), "RejUnknownId", 3, "three of them")
    return "counted, and nothing else"


_FAULTS = (
    ("crc", Fault("a wrong CRC", "RejCrc", _bad_crc)),
    ("length", Fault("seven bytes", "RejLength", _short)),
    ("repetition", Fault("the same counter", "RejRepeated", _repeated)),
    ("sequence", Fault("a counter that jumps", "RejSequence", _jumping)),
)
CASES = (
    *(
        Case(
            f"e2e-{name}", f"frames with {fault.what} are dropped, counted, and feed no deadline", _feeds_nothing(fault)
        )
        for name, fault in _FAULTS
    ),
    Case("mac-forged", "an ACT with a wrong MAC is a HOLD, counted", _forged),
    Case("act-altered", "an ACT_AUTH authorises no other ACT_CMD than its own", _altered),
    Case("replay-pair", "a pair that was accepted is not accepted again", _replayed_pair),
    Case("replay-queue", "a queue of stale commands gives no assist", _queue),
    Case("unknown-identifier", "identifiers that are nobody's are counted, and nothing else", _unknown),
)
