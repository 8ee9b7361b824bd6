"""What a device says by itself: cycles, counters, soundness of its frames."""

from __future__ import annotations

from itertools import pairwise

from hilbridge.conformance.cases.case import Case, Run
from hilbridge.conformance.findings import Unshown, demand
from hilbridge.conformance.tester import ByHand
from hilbridge.limits import MS, PROTOCOL_VERSION

_OFF = 0.05  # of a mean period
_WATCH_MS = 2_000.0


def _period(name: str, cycle_ms: float) -> Run:
    """Mean and longest gap. A status may come earlier on a change of state: a device in FOLLOW does not change."""

    def run(tester: ByHand) -> str:
        tester.to_follow()
        tester.run(100.0)
        began_ns = tester.line.now_ns()
        tester.run(_WATCH_MS)
        stamps = [heard.at_ns for heard in tester.hearing.since(began_ns) if heard.name == name]
        demand(len(stamps) >= 3, f"{len(stamps)} in {_WATCH_MS / 1000:g} s")
        mean_ms = (stamps[-1] - stamps[0]) / (len(stamps) - 1) / MS
        longest_ms = max((after - before) / MS for before, after in pairwise(stamps))
        seen = f"every {mean_ms:.1f} ms, longest {longest_ms:.1f} ms, {len(stamps)} frames"
        demand(abs(mean_ms - cycle_ms) <= _OFF * cycle_ms, seen)
        demand(longest_ms <= 3 * cycle_ms, seen)
        return seen

    return run


def _version(tester: ByHand) -> str:
    tester.to_follow()
    version = tester.hearing.newest["CTRL_HB"].signals["ProtocolVersion"]
    demand(version == PROTOCOL_VERSION, f"version {version}")
    return f"version {version}"


def _diag(tester: ByHand) -> str:
    tester.to_follow()
    asked_ns = tester.line.now_ns()
    tester.run(1_200.0)
    told = [name for name, (at_ns, _) in tester.hearing.diag.items() if at_ns >= asked_ns]
    multiplexer = tester.codec.messages["CTRL_DIAG"]
    demand(len(told) == len(multiplexer.groups), f"{len(told)} of {len(multiplexer.groups)} counters in 1.2 s")
    return f"{len(told)} counters"


def sound(tester: ByHand) -> str:
    """Judged last, over everything that was heard."""
    hearing = tester.hearing
    if not hearing.log:
        raise Unshown("nothing was heard")
    wrong = hearing.unsound[:3]
    demand(not wrong, f"{len(hearing.unsound)} of {len(hearing.log)}: {', '.join(wrong)}")
    lost = hearing.wire.counters["LostFrames"]
    demand(lost <= len(hearing.log) // 1000, f"{lost} frames missing by their counters, of {len(hearing.log)}")
    return f"{len(hearing.log)} frames, {lost} missing"


CASES = (
    Case("version", f"CTRL_HB has protocol version {PROTOCOL_VERSION}", _version),
    Case("status-period", "CTRL_STATUS every 20 ms", _period("CTRL_STATUS", 20.0)),
    Case("measurement-period", "CTRL_MEAS every 20 ms", _period("CTRL_MEAS", 20.0)),
    Case("heartbeat-period", "CTRL_HB every 100 ms", _period("CTRL_HB", 100.0)),
    Case("diag-round", "CTRL_DIAG tells each counter within a second", _diag),
)
LAST = (Case("frames-sound", "every frame has a right CRC, length, range and the next counter", sound),)
