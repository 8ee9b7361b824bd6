"""Arming: who may, with what, when, and what a session is worth."""

from __future__ import annotations

from itertools import pairwise

from hilbridge.conformance.cases.case import Case, risen, stays
from hilbridge.conformance.findings import Heard, Unshown, demand
from hilbridge.conformance.tester import HOLD, SILENT, ByHand

_UNASSISTED = ("Follow", "Ready", "RampDown")


def _arming(tester: ByHand) -> str:
    tester.to_follow()
    tester.wish = SILENT
    asked_ns = tester.line.now_ns()

    def challenges() -> list[Heard]:
        return [one for one in tester.hearing.since(asked_ns) if one.name == "ARM_CHALLENGE"]

    if not tester.handshake("Arm"):
        tester.run(700.0)
        late = [f"it comes after {(one.at_ns - asked_ns) / 1e6:.0f} ms" for one in challenges()][:1]
        cure = "answer in the tick of the request, below nothing more urgent on the bus"
        demand(False, f"no ARM_CHALLENGE within 300 ms of ARM_REQUEST, {''.join(late) or 'nor in a second'}; {cure}")
    armed = tester.until(lambda: tester.hearing.session == tester.session != 0, 200.0)
    demand(armed, f"session {tester.hearing.session}, not {tester.session}, 200 ms after a right ARM_RESPONSE")
    took_ms = (tester.hearing.newest["CTRL_STATUS"].at_ns - asked_ns) / 1e6
    demand(tester.hearing.state == "Follow", f"{tester.hearing.state} without one HOLD")
    count = len(challenges())
    demand(count == 1, f"{count} challenges to one request; take a second device off the bus, or answer once")
    return f"session {tester.session} after {took_ms:.0f} ms"


def _neutral(tester: ByHand) -> str:
    """Two HOLDs and an ACT, again and again, are never three HOLDs in a row."""
    tester.arm()
    tester.wish = SILENT
    if tester.hearing.state == "Ready":
        tester.arm()
        tester.wish = SILENT
    for _ in range(3):
        tester.act()
        stays(tester, ("Follow",), 40.0, "an ACT in FOLLOW")
        for count in (1, 2):
            tester.send(tester.command(HOLD))
            stays(tester, ("Follow",), 40.0, f"{count} HOLD after an ACT")
    tester.send(tester.command(HOLD))
    ready = tester.until(lambda: tester.hearing.state == "Ready", 60.0)
    demand(ready, f"{tester.hearing.state} after three HOLDs in a row")
    return "Ready with the third HOLD in a row"


def _unarmed(tester: ByHand) -> str:
    tester.to_ready()
    tester.wish = SILENT
    if not tester.until(lambda: tester.hearing.session == 0, 400.0):
        raise Unshown("the session does not end with silence")
    tester.wish = HOLD
    tester.run(200.0)
    before = tester.counts("RejNotArmed")
    tester.wish = SILENT
    for _ in range(2):  # a third would come after the command deadline, and fail by its E2E machine
        tester.act()
        stays(tester, ("Follow",), 35.0, "ACTs without a session")
    tester.wish = HOLD
    risen(before, tester.counts("RejNotArmed"), "RejNotArmed", 2, "2 ACTs without a session")
    return "2 ACTs, both refused and counted"


def _foreign_session(tester: ByHand) -> str:
    tester.to_ready()
    before = tester.counts("RejSession")
    tester.wish = SILENT
    tester.act(Session=tester.session % 255 + 1)
    stays(tester, _UNASSISTED, 40.0, "an ACT of another session")
    tester.wish = HOLD
    risen(before, tester.counts("RejSession"), "RejSession", 1, "one ACT of another session")
    return "refused and counted"


def _late_response(tester: ByHand) -> str:
    tester.to_follow()
    if tester.hearing.session:
        tester.wish = SILENT
        tester.until(lambda: tester.hearing.session == 0, 400.0)
        tester.wish = HOLD
    before = tester.counts("RejHandshake")
    if not tester.handshake("Arm", wait_ms=510.0 + tester.setting.margin_ms):
        raise Unshown("no challenge")
    tester.run(100.0)
    demand(tester.hearing.session == 0, "armed by a response more than 500 ms after its challenge")
    risen(before, tester.counts("RejHandshake"), "RejHandshake", 1, "one late ARM_RESPONSE")
    return "refused and counted"


def _response_once(tester: ByHand) -> str:
    """The same answer again, with a new counter, finds no challenge."""
    tester.to_follow()
    nonce = tester.setting.chance.getrandbits(32)
    challenge = tester.ask("Arm", nonce)
    if challenge is None:
        raise Unshown("no challenge")
    tester.answer("Arm", nonce, challenge)
    tester.run(60.0)
    before = tester.counts("RejHandshake")
    tester.answer("Arm", nonce, challenge)
    tester.run(60.0)
    risen(before, tester.counts("RejHandshake"), "RejHandshake", 1, "an ARM_RESPONSE sent twice")
    return "the second is refused and counted"


def _challenges(tester: ByHand) -> str:
    tester.to_follow()
    nonces, numbers = [], []
    for _ in range(5):
        challenge = tester.ask("Arm", tester.setting.chance.getrandbits(32))
        if challenge is None:
            raise Unshown("no challenge")
        nonces.append(challenge[0])
        numbers.append(challenge[1])
        tester.run(40.0)
    demand(len(set(nonces)) == len(nonces), f"nonces repeat: {nonces}")
    steps = [(after - before) % 255 for before, after in pairwise(numbers)]
    demand(steps == [1] * 4, f"session numbers {numbers}")
    tester.run(600.0)  # the open challenges, which others have asked over, run out
    return f"sessions {numbers[0]} to {numbers[-1]}, no nonce twice"


def _heartbeat(tester: ByHand) -> str:
    """HOLDs go on, BRIDGE_HB stops: only the session is lost, and at its limit."""
    tester.to_ready()
    tester.run(100.0)
    tester.beats = False
    last_ns = tester.send(tester.heartbeat())
    margin_ms = tester.setting.margin_ms
    ended = tester.until(lambda: tester.hearing.session == 0, 250.0 + 20.0 + margin_ms)
    demand(ended, f"still armed {270 + margin_ms:.0f} ms after the last BRIDGE_HB")
    took_ms = (tester.hearing.newest["CTRL_STATUS"].at_ns - last_ns) / 1e6
    demand(took_ms >= 245.0, f"disarmed after {took_ms:.0f} ms already")
    return f"disarmed after {took_ms:.0f} ms"


CASES = (
    Case("arming", "request, one challenge, response: armed, and in Follow", _arming),
    Case("neutral-first", "Ready needs three HOLDs in a row", _neutral),
    Case("act-unarmed", "an ACT without a session is a HOLD, counted", _unarmed),
    Case("act-other-session", "an ACT with another session's number is a HOLD, counted", _foreign_session),
    Case("response-late", "an ARM_RESPONSE later than 500 ms arms nothing", _late_response),
    Case("response-once", "a challenge is answered once", _response_once),
    Case("challenges", "each challenge has a new nonce and the next session number", _challenges),
    Case("heartbeat-silence", "250 ms without BRIDGE_HB end the session", _heartbeat),
)
