"""The findings for people, programs and CI systems."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from hilbridge.conformance.findings import Finding, Verdict
from hilbridge.conformance.report import as_json, line_of, passed, summary_of, write_junit

KEPT = Finding("acts", "it acts", Verdict.KEPT, "Assist after 1 ms", 0.2)
BROKEN = Finding("dwell", "it ends", Verdict.BROKEN, "still <Assist>", 10.0)
UNSHOWN = Finding("reset", "it is left", Verdict.UNSHOWN, "nobody clears it", 0.1)


def test_what_could_not_be_shown_is_no_pass() -> None:
    assert passed([KEPT])
    assert not passed([KEPT, UNSHOWN])
    assert not passed([KEPT, BROKEN])


def test_a_line_has_verdict_name_claim_and_what_was_seen() -> None:
    assert line_of(BROKEN).split() == ["broken", "dwell", "it", "ends:", "still", "<Assist>"]
    assert summary_of([KEPT, BROKEN, UNSHOWN]) == "3 claims in 10 s: 1 kept, 1 broken, 1 not shown"


def test_junit_has_a_case_a_claim(tmp_path: Path) -> None:
    path = tmp_path / "conformance.xml"
    write_junit([KEPT, BROKEN, UNSHOWN], "can0", path)
    suite = ET.parse(path).getroot()
    assert (suite.get("tests"), suite.get("failures")) == ("3", "2")
    failed = {case.get("name"): case.find("failure") for case in suite}
    assert failed["acts"] is None
    assert failed["dwell"] is not None
    assert failed["dwell"].get("message") == "still <Assist>"
    assert failed["reset"] is not None
    assert failed["reset"].get("type") == "not shown"


def test_json_says_whether_all_is_kept() -> None:
    told = as_json([KEPT, BROKEN], "can0")
    assert (told["bus"], told["passed"], len(told["findings"])) == ("can0", False, 2)
