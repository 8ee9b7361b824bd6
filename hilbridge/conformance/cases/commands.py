"""What an ACT has to be, and that whatever it lacks makes it a HOLD."""

from __future__ import annotations

from hilbridge.conformance.cases.case import Case, Run, risen, stays
from hilbridge.conformance.findings import demand
from hilbridge.conformance.tester import HOLD, OTHER_VERB, SILENT, VERB, ByHand
from hilbridge.limits import MS, SENSING_LIMIT_MS

_UNASSISTED = ("Follow", "Ready", "RampDown")


def _acts(tester: ByHand) -> str:
    tester.to_ready()
    asked_ns = tester.act()
    demand(tester.until(lambda: tester.hearing.state == "Assist", 40.0), f"{tester.hearing.state} after 40 ms")
    status = tester.hearing.newest["CTRL_STATUS"]
    demand(status.signals["AppliedVerb"] == VERB, f"applies {status.signals['AppliedVerb']}, not {VERB}")
    return f"Assist after {(status.at_ns - asked_ns) / MS:.0f} ms"


def _other_verb(tester: ByHand) -> str:
    tester.to_assist()
    tester.wish = SILENT
    began_ns = tester.act(OTHER_VERB)
    tester.run(60.0)
    told = [heard.signals for heard in tester.hearing.since(began_ns) if heard.name == "CTRL_STATUS"]
    states = [signals["State"] for signals in told]
    demand("RampDown" in states, f"{', '.join(dict.fromkeys(map(str, states)))} after an ACT for another verb")
    demand(not any(signals["AppliedVerb"] == OTHER_VERB for signals in told), "the other verb at once, without a ramp")
    return "through RampDown"


def _lacking(what: str, counter: str, **fields: int | str) -> Run:
    """One ACT that lacks one thing, in Ready and with a right MAC."""

    def run(tester: ByHand) -> str:
        tester.to_ready()
        before = tester.counts(counter)
        tester.wish = SILENT
        verb = str(fields.get("Verb", VERB))
        tester.act(verb, **fields)
        stays(tester, _UNASSISTED, 40.0, what)
        tester.wish = HOLD
        risen(before, tester.counts(counter), counter, 1, what)
        return "refused and counted"

    return run


def _unassisted(tester: ByHand) -> str:
    tester.to_ready()
    before = tester.counts("RejVerb")
    verbs = ("None", "Move Around", "Other")
    for verb in verbs:
        tester.to_ready()
        tester.wish = SILENT
        tester.act(verb)
        stays(tester, _UNASSISTED, 30.0, f"an ACT for {verb}")
        tester.wish = HOLD
        tester.run(160.0)
    risen(before, tester.counts("RejVerb"), "RejVerb", len(verbs), f"ACTs for {', '.join(verbs)}")
    return f"{len(verbs)} verbs, all refused and counted"


def _stale_echo(tester: ByHand) -> str:
    """An echo that was told 105 ms ago and more, but less than the 8-bit counter's round."""
    tester.to_ready()
    before = tester.counts("RejEcho")
    tester.run(160.0)
    now_ns = tester.line.now_ns()
    limit_ns = round((105.0 + tester.setting.margin_ms) * MS)
    statuses = [heard for heard in tester.hearing.since(now_ns - 400 * MS) if heard.name == "CTRL_STATUS"]
    old = [heard for heard in statuses if now_ns - heard.at_ns >= limit_ns]
    tester.wish = SILENT
    tester.act(Echo=old[-1].counter)
    stays(tester, _UNASSISTED, 40.0, f"an ACT with an echo {(now_ns - old[-1].at_ns) / MS:.0f} ms old")
    tester.wish = HOLD
    risen(before, tester.counts("RejEcho"), "RejEcho", 1, "one ACT with a stale echo")
    return f"an echo {(now_ns - old[-1].at_ns) / MS:.0f} ms old is refused and counted"


def _stale_hold(tester: ByHand) -> str:
    tester.to_ready()
    tester.wish = SILENT
    tester.send(tester.command(HOLD, SensingAge=SENSING_LIMIT_MS + 2))
    follows = tester.until(lambda: tester.hearing.state == "Follow", 40.0)
    demand(follows, f"{tester.hearing.state} after a HOLD on stale sensing")
    tester.wish = HOLD
    return "Follow"


def _no_auth(tester: ByHand) -> str:
    tester.to_assist()
    before = tester.counts("RejAuthMissing")
    tester.to_assist()
    tester.wish = SILENT
    began_ns = tester.send(tester.command(VERB))
    left = tester.until(lambda: tester.hearing.state != "Assist", 40.0)
    demand(left, "still Assist 40 ms after an ACT without ACT_AUTH")
    took_ms = (tester.hearing.newest["CTRL_STATUS"].at_ns - began_ns) / MS
    demand(took_ms <= 12.0 + tester.setting.margin_ms, f"a HOLD only after {took_ms:.0f} ms")
    tester.wish = HOLD
    risen(before, tester.counts("RejAuthMissing"), "RejAuthMissing", 1, "one ACT without ACT_AUTH")
    return f"a HOLD after {took_ms:.0f} ms"


def _late_auth(tester: ByHand) -> str:
    tester.to_ready()
    tester.wish = SILENT
    command = tester.command(VERB)
    tester.send(command)
    tester.run(12.0 + tester.setting.margin_ms)
    tester.send(tester.authorisation(command))
    stays(tester, _UNASSISTED, 40.0, "an ACT_AUTH more than 10 ms after its ACT_CMD")
    return "refused"


def _lost_one(tester: ByHand) -> str:
    """One command lost: 80 ms between two."""
    tester.to_assist()
    tester.run(80.0)
    lost: list[int] = []

    def lose(frame: object) -> list[object]:
        lost.append(1)
        return [] if len(lost) == 1 else [frame]

    tester.alter = lose  # type: ignore[assignment]
    stays(tester, ("Assist",), 160.0, "one lost command")
    return "still Assist"


def _dwell(tester: ByHand) -> str:
    tester.to_ready()
    tester.wish = VERB
    if not tester.until(lambda: tester.hearing.state == "Assist", 100.0):
        demand(False, f"{tester.hearing.state}, not Assist")
    began_ns = tester.hearing.newest["CTRL_STATUS"].at_ns
    left = tester.until(lambda: tester.hearing.state != "Assist", 10_000.0 + 20.0 + tester.setting.margin_ms)
    took_ms = (tester.line.now_ns() - began_ns) / MS
    demand(left, f"still Assist after {took_ms / 1000:.2f} s")
    demand(took_ms >= 9_900.0, f"ended after {took_ms / 1000:.2f} s ({tester.hearing.reason})")
    return f"ended after {took_ms / 1000:.2f} s"


CASES = (
    Case("acts", "an authorised ACT in Ready assists", _acts),
    Case("verb-change", "an ACT for another verb goes through RampDown", _other_verb),
    Case("verb-unassisted", "Move Around, Other and None are never assisted", _unassisted),
    Case("echo-stale", "an ACT whose echo is older than 100 ms is a HOLD, counted", _stale_echo),
    Case(
        "sensing-stale",
        "an ACT on sensing older than 150 ms is a HOLD, counted",
        _lacking("an ACT on sensing 152 ms old", "RejAge", SensingAge=SENSING_LIMIT_MS + 2),
    ),
    Case("sensing-stale-hold", "a HOLD on stale sensing is a fault: Follow", _stale_hold),
    Case("auth-missing", "an ACT without ACT_AUTH is a HOLD after 10 ms, counted", _no_auth),
    Case("auth-late", "an ACT_AUTH after 10 ms authorises nothing", _late_auth),
    Case("lost-frame", "one lost command ends no assist", _lost_one),
    Case("dwell", "an assist ends after 10 s", _dwell),
)
