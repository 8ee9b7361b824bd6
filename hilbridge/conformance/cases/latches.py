"""What latches, that a latch stays, and the four things that end one."""

from __future__ import annotations

from collections.abc import Callable

from hilbridge.conformance.cases.case import Case, Run, stays
from hilbridge.conformance.findings import Unshown, demand
from hilbridge.conformance.tester import HOLD, SILENT, VERB, ByHand
from hilbridge.records import Frame

_HAND_MS = 700.0


def _latched(tester: ByHand, reason: str, limit_ms: float, after: str) -> None:
    """Latched for that reason, and told by CTRL_EMCY; otherwise Broken."""
    latched = tester.until(lambda: tester.hearing.state == "Latched", limit_ms)
    demand(latched, f"{tester.hearing.state} ({tester.hearing.reason}) after {after}")
    demand(tester.hearing.reason == reason, f"Latched for {tester.hearing.reason}, not {reason}, after {after}")
    tester.run(20.0)
    emergency = tester.hearing.newest.get("CTRL_EMCY")
    demand(emergency is not None and emergency.signals["Code"] == reason, f"no CTRL_EMCY tells {reason}")


def _trips(tester: ByHand) -> str:
    tester.anew()
    for count in (1, 2, 3):
        tester.to_ready()
        tester.wish = SILENT
        left = tester.until(lambda: tester.hearing.state != "Ready", 130.0 + tester.setting.margin_ms)
        demand(left, f"{tester.hearing.state} in silence")
        if count < 3:
            stays(tester, ("Follow",), 40.0, f"{count} trips")
    _latched(tester, "RepeatedTrips", 60.0, "three trips")
    return "Follow, Follow, Latched"


def _macs(tester: ByHand) -> str:
    tester.anew()
    for count in (1, 2, 3):
        tester.to_ready()
        tester.wish = SILENT
        command = tester.command(VERB)
        tester.send(command, tester.authorisation(command, flip=0x80000000))
        if count < 3:
            stays(tester, ("Ready", "RampDown", "Follow"), 40.0, f"{count} wrong MACs")
            tester.wish = HOLD
            tester.run(80.0)
    _latched(tester, "MacFailures", 60.0, "three wrong MACs")
    return "the third latches"


def _own_identifier(tester: ByHand) -> str:
    tester.anew()
    tester.to_ready()
    tester.send(Frame(tester.codec.messages["CTRL_STATUS"].can_id, bytes(8)))
    _latched(tester, "OwnIdSeen", 60.0, "a frame with its own identifier")
    return "Latched"


_FORMS: dict[str, Callable[[Frame], Frame]] = {
    "plain": lambda stop: stop,
    "of 8 bytes": lambda stop: stop._replace(data=bytes(8)),
    "remote": lambda stop: stop._replace(is_remote=True),
    "extended": lambda stop: stop._replace(is_extended=True),
}


def _stop_forms(tester: ByHand) -> str:
    for form, made in _FORMS.items():
        tester.to_ready()
        tester.send(made(Frame(tester.codec.messages["STOP"].can_id, b"")))
        stopped = tester.until(lambda: tester.hearing.state == "EStop", 25.0 + tester.setting.margin_ms)
        demand(stopped, f"{tester.hearing.state} after a STOP {form}")
    return f"{', '.join(_FORMS)}: all stop"


def _stop_in_follow(tester: ByHand) -> str:
    tester.to_follow()
    if tester.hearing.state == "Ready":
        tester.wish = SILENT
        tester.until(lambda: tester.hearing.state == "Follow", 300.0)
    tester.stop()
    stopped = tester.until(lambda: tester.hearing.state == "EStop", 25.0 + tester.setting.margin_ms)
    demand(stopped, f"{tester.hearing.state} after a STOP in Follow")
    return "EStop"


def _latch(tester: ByHand) -> None:
    """A latch to try things on, with HOLD present and at rest."""
    tester.plain()
    if tester.hearing.state != "Latched":
        tester.to_ready()
        tester.send(Frame(tester.codec.messages["CTRL_STATUS"].can_id, bytes(8)))
    if not tester.until(lambda: tester.hearing.state == "Latched" and tester.hearing.at_rest, 1_500.0):
        raise Unshown("an own identifier from outside does not latch it")


def _stays(tester: ByHand) -> str:
    _latch(tester)
    stays(tester, ("Latched",), 400.0, "HOLDs in a latch")
    tester.wish = VERB
    stays(tester, ("Latched",), 200.0, "ACTs in a latch")
    tester.wish = HOLD
    demand(not tester.handshake("Arm"), "a request to arm is answered in a latch")
    tester.beats, tester.wish = False, SILENT
    stays(tester, ("Latched",), 400.0, "silence in a latch")
    return "HOLD, ACT, arming, silence: Latched"


def _pressed(tester: ByHand, after: str) -> None:
    assert tester.setting.press is not None
    tester.setting.press()
    stays(tester, ("Latched",), _HAND_MS, after)


def _lacks(what: str, prepare: Callable[[ByHand], object]) -> Run:
    """The hand at the device, with one of the other things lacking."""

    def run(tester: ByHand) -> str:
        if tester.setting.press is None:
            raise Unshown("needs a hand at the device; give --clear-command, or a terminal")
        _latch(tester)
        prepare(tester)
        tester.run(150.0)
        _pressed(tester, f"the hand, {what}")
        return "Latched"

    return run


def _silent_after_handshake(tester: ByHand) -> None:
    tester.handshake("ClearLatch")
    tester.run(60.0)
    tester.wish = SILENT


def _no_hand(tester: ByHand) -> str:
    _latch(tester)
    tester.handshake("ClearLatch")
    stays(tester, ("Latched",), _HAND_MS, "an authenticated ClearLatch without a hand")
    return "Latched"


def _reset(tester: ByHand) -> str:
    _latch(tester)
    began_ns = tester.line.now_ns()
    tester.clear()
    follows = tester.until(lambda: tester.hearing.state == "Follow", 1_000.0)
    demand(follows, f"{tester.hearing.state} after it was cleared")
    states = [str(heard.signals["State"]) for heard in tester.hearing.since(began_ns) if heard.name == "CTRL_STATUS"]
    way = list(dict.fromkeys(states))
    demand(way == ["Latched", "SelfTest", "Follow"], f"its way was {', '.join(way)}")
    demand(tester.hearing.session == 0, "it is armed after being cleared")
    return "SelfTest, then Follow, not armed"


# In this order: a latch that stays is used again by the next.
CASES = (
    Case("three-trips", "three trips in 60 s latch, two do not", _trips),
    Case("three-macs", "three wrong MACs latch, two do not", _macs),
    Case("own-identifier", "an own identifier from outside latches", _own_identifier),
    Case("latch-stays", "HOLD, ACT, a request to arm and silence leave a latch as it is", _stays),
    Case("reset-without-hand", "no authenticated challenge clears without a hand at the device", _no_hand),
    Case("reset-without-hold", "no hand clears without a HOLD present", _lacks("no HOLD", _silent_after_handshake)),
    Case("reset", "at rest, held, authenticated and confirmed it goes by SelfTest to Follow", _reset),
    Case("reset-unauthenticated", "no hand clears without a challenge", _lacks("no challenge", lambda tester: None)),
    Case(
        "reset-wrong-mac",
        "no hand clears after a ClearLatch with a wrong MAC",
        _lacks("a wrong MAC", lambda tester: tester.handshake("ClearLatch", flip=1)),
    ),
    Case("stop-forms", "a STOP in any form stops", _stop_forms),
    Case("stop-in-follow", "a STOP stops an unarmed device, too", _stop_in_follow),
)
