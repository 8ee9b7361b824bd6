"""The findings as a table, as JSON, and as JUnit, which every CI system shows."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hilbridge.conformance.findings import Finding, Verdict
from hilbridge.files import in_place_of


def line_of(finding: Finding) -> str:
    """One line of the table."""
    return f"{finding.verdict:<9}  {finding.name:<22}  {finding.claim}: {finding.seen}"


def summary_of(findings: Sequence[Finding]) -> str:
    """The last line."""
    counts = {verdict: sum(finding.verdict is verdict for finding in findings) for verdict in Verdict}
    took_s = sum(finding.seconds for finding in findings)
    told = ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count)
    return f"{len(findings)} claims in {took_s:.0f} s: {told}"


def passed(findings: Sequence[Finding]) -> bool:
    """Every claim was shown to be kept."""
    return all(finding.verdict is Verdict.KEPT for finding in findings)


def as_json(findings: Sequence[Finding], bus: str) -> dict[str, Any]:
    """One object."""
    rows = [{**finding._asdict(), "seconds": round(finding.seconds, 3)} for finding in findings]
    return {"bus": bus, "passed": passed(findings), "findings": rows}


def write_junit(findings: Sequence[Finding], bus: str, path: Path) -> None:
    """One test case a claim; one that could not be shown fails, too."""
    failures = sum(finding.verdict is not Verdict.KEPT for finding in findings)
    suite = ET.Element(
        "testsuite",
        name="hilbridge conformance",
        tests=str(len(findings)),
        failures=str(failures),
        errors="0",
        skipped="0",
        time=f"{sum(finding.seconds for finding in findings):.3f}",
    )
    for finding in findings:
        case = ET.SubElement(
            suite, "testcase", classname=f"conformance.{bus}", name=finding.name, time=f"{finding.seconds:.3f}"
        )
        if finding.verdict is not Verdict.KEPT:
            ET.SubElement(case, "failure", type=str(finding.verdict), message=finding.seen).text = finding.claim
        else:
            ET.SubElement(case, "system-out").text = f"{finding.claim}: {finding.seen}"
    ET.indent(suite)
    with in_place_of(path) as partial:
        ET.ElementTree(suite).write(partial, encoding="utf-8", xml_declaration=True)
