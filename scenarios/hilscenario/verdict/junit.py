"""Results as JUnit XML, which every CI system shows."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

from hilbridge.files import in_place_of
from hilscenario.verdict.judging import Result, Skipped

_FORBIDDEN = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd]")


def write_junit(results: Sequence[Result], path: Path, skipped: Sequence[Skipped] = ()) -> None:
    """One test case a scenario; a failure's text has every problem and the command that repeats it."""
    failures = sum(not result.passed for result in results)
    suite = ET.Element(
        "testsuite",
        name="hilscenario",
        tests=str(len(results) + len(skipped)),
        failures=str(failures),
        skipped=str(len(skipped)),
        errors="0",
        time=f"{sum(result.cpu_s for result in results):.3f}",
    )
    for result in results:
        case = ET.SubElement(
            suite, "testcase", classname="scenarios", name=_clean(result.name), time=f"{result.cpu_s:.3f}"
        )
        if not result.passed:
            problems = result.problems()
            failure = ET.SubElement(case, "failure", message=_clean(problems[0]))
            failure.text = _clean("\n".join([*problems, f"repeat: {result.replay}"]))
    for one in skipped:
        case = ET.SubElement(suite, "testcase", classname="scenarios", name=_clean(one.name), time="0.000")
        ET.SubElement(case, "skipped", message=_clean(f"{one.file}: {one.why}"))
    ET.indent(suite)
    with in_place_of(path) as partial:
        ET.ElementTree(suite).write(partial, encoding="utf-8", xml_declaration=True)


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("?", text)
