"""All cases in their order, and how they are gone through."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from hilbridge.conformance.cases import commands, errors, latches, presence, session, timing
from hilbridge.conformance.cases.case import Case
from hilbridge.conformance.findings import Broken, Finding, Unshown, Verdict
from hilbridge.conformance.tester import ByHand
from hilbridge.errors import InputError, nearest

CASES: tuple[Case, ...] = (
    *presence.CASES,
    *session.CASES,
    *commands.CASES,
    *errors.CASES,
    *timing.CASES,
    *latches.CASES,
    *presence.LAST,
)


def chosen(names: Sequence[str]) -> tuple[Case, ...]:
    """The cases of these names, in the plan's order; all without any. Raises InputError."""
    known = [case.name for case in CASES]
    for name in names:
        if name not in known:
            raise InputError(f"--only {name}: no such case; {nearest(name, known)}")
    return tuple(case for case in CASES if not names or case.name in names)


def conduct(
    tester: ByHand, cases: Sequence[Case], show: Callable[[Finding], None] = lambda finding: None
) -> list[Finding]:
    """Greet the device and try each; one that is broken or cannot be shown ends none of the others."""
    tester.greet()
    findings = []
    for case in cases:
        began_ns = tester.line.now_ns()
        verdict, seen = _judged(tester, case)
        finding = Finding(case.name, case.claim, verdict, seen, (tester.line.now_ns() - began_ns) / 1e9)
        findings.append(finding)
        show(finding)
    return findings


def _judged(tester: ByHand, case: Case) -> tuple[Verdict, str]:
    tester.plain()
    try:
        return Verdict.KEPT, case.run(tester)
    except Broken as broken:
        return Verdict.BROKEN, str(broken)
    except Unshown as unshown:
        return Verdict.UNSHOWN, str(unshown)
