"""How long assist torque outlives its reason, at random phases of every cycle."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

from hilbridge.conformance.cases.case import Case, Run
from hilbridge.conformance.findings import Heard, Unshown, demand
from hilbridge.conformance.hearing import shows_assist
from hilbridge.conformance.tester import HOLD, SILENT, ByHand
from hilbridge.limits import MS

STATUS_MS = 20.0
_TRIES = 3  # a phase whose frames came unevenly is tried again so often


class Fall(NamedTuple):
    """After the last reason for assist: when it was seen last, when it was told zero for good; ms."""

    last_seen_ms: float
    zero_told_ms: float | None


def fall_of(heard: list[Heard], from_ns: int) -> Fall:
    """Of what was heard since. Pure."""
    told = [one for one in heard if one.name in ("CTRL_STATUS", "CTRL_MEAS")]
    seen = [one.at_ns for one in told if shows_assist(one)]
    last_ns = max(seen, default=from_ns)
    zero = [one.at_ns for one in told if one.name == "CTRL_STATUS" and not shows_assist(one) and one.at_ns > last_ns]
    return Fall((last_ns - from_ns) / MS, (zero[0] - from_ns) / MS if zero else None)


def even(heard: list[Heard], margin_ms: float) -> bool:
    """Whether CTRL_MEAS came every 20 ms: otherwise a computer on the way was late, and stamps say little."""
    stamps = [one.at_ns for one in heard if one.name == "CTRL_MEAS"]
    gaps_ms = [(after - before) / MS for before, after in pairwise(stamps)]
    return len(stamps) >= 3 and all(abs(gap_ms - STATUS_MS) <= margin_ms for gap_ms in gaps_ms)


class Ending(NamedTuple):
    """What ends an assist: `act` does it and returns when; the limit of torque; states that may come of it."""

    what: str
    limit_ms: float
    act: Callable[[ByHand], int]
    into: tuple[str, ...]


def _hold(tester: ByHand) -> int:
    tester.wish = HOLD
    tester.next_command_in(40.0)
    return tester.send(tester.command(HOLD))


def _stop(tester: ByHand) -> int:
    tester.wish = SILENT
    return tester.stop()


def _silence(tester: ByHand) -> int:
    """The time of the last command, which counts; a bridge that hangs sends no heartbeat either."""
    tester.wish, tester.beats = SILENT, False
    command_id = tester.codec.messages["ACT_AUTH"].can_id
    assert any(frame.can_id == command_id for frame in tester.sent)
    return tester.last_act_ns


ENDINGS = (
    Ending("HOLD", 60.0, _hold, ("Ready",)),
    Ending("STOP", 20.0, _stop, ("EStop",)),
    Ending("silence", 150.0, _silence, ("Follow", "Latched")),
)


def _trial(tester: ByHand, ending: Ending) -> Fall | None:
    """One phase; None where the frames came unevenly."""
    tester.to_assist()
    tester.run(tester.setting.chance.uniform(0.0, 80.0))
    if tester.hearing.assist_zero:
        tester.to_assist()
    margin_ms = tester.setting.margin_ms
    from_ns = ending.act(tester)
    tester.run(ending.limit_ms + 2 * STATUS_MS + margin_ms)
    heard = tester.hearing.since(from_ns)
    if not even(heard, margin_ms):
        return None
    demand(tester.hearing.state in ending.into, f"{tester.hearing.state} after {ending.what}")
    return fall_of(heard, from_ns)


def _falls(ending: Ending) -> Run:
    def run(tester: ByHand) -> str:
        margin_ms = tester.setting.margin_ms
        last, told = 0.0, 0.0
        for _ in range(tester.setting.phases):
            falls = (_trial(tester, ending) for _ in range(_TRIES))
            fall = next((one for one in falls if one is not None), None)
            if fall is None:
                raise Unshown("CTRL_MEAS comes unevenly: this computer or the bus is too busy to measure by")
            last = max(last, fall.last_seen_ms)
            limit_ms = ending.limit_ms + margin_ms
            demand(last <= limit_ms, f"assist {last:.0f} ms after {ending.what}, {limit_ms:.0f} allowed")
            demand(fall.zero_told_ms is not None, f"zero is never told after {ending.what}")
            told = max(told, fall.zero_told_ms or 0.0)
            demand(told <= limit_ms + STATUS_MS, f"zero is told {told:.0f} ms after {ending.what}")
        return f"{tester.setting.phases} phases: assist last seen after {last:.0f} ms, zero told by {told:.0f} ms"

    return run


def _not_before(tester: ByHand) -> str:
    """The command deadline is 100 ms: neither later nor so early that a lost frame trips it."""
    tester.anew()
    tester.to_assist()
    tester.run(20.0)
    from_ns = _silence(tester)
    margin_ms = tester.setting.margin_ms
    left = tester.until(lambda: tester.hearing.state != "Assist", 101.0 + STATUS_MS + margin_ms)
    demand(left, f"Assist {121 + margin_ms:.0f} ms after the last command")
    took_ms = (tester.hearing.newest["CTRL_STATUS"].at_ns - from_ns) / MS
    seen = f"{tester.hearing.state} after {took_ms:.0f} ms"
    demand(98.0 - margin_ms <= took_ms <= 103.0 + margin_ms, seen)
    return seen


CASES = (
    Case("command-deadline", "100 ms without a command end an assist, not less and not more", _not_before),
    *(
        Case(
            f"{ending.what.lower()}-to-zero",
            f"{ending.what} to zero assist within {ending.limit_ms:.0f} ms, at every phase",
            _falls(ending),
        )
        for ending in ENDINGS
    ),
)
