"""The catalogue's dropouts live on a kernel bus: the same files, real processes, the same verdicts (issue 5): H2, H7, H8."""

from __future__ import annotations

import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

CATALOG = Path(__file__).parents[2] / "scenarios" / "catalog"
# A sensor off, both at once, flapping; a process that hangs, and one that dies.
DROPOUTS = ("dropout-gaze-off", "dropout-both-at-once", "dropout-flapping", "bridge-hang", "bridge-kill")

pytestmark = [pytest.mark.vcan, pytest.mark.timeout(600)]


def test_h2_h7_h8_the_catalogues_dropouts_are_green_live_on_vcan(tmp_path: Path) -> None:
    files = [str(CATALOG / f"{name}.yaml") for name in DROPOUTS]
    words = ["run", *files, "--live", "--bus", "vcan0", "--out", str(tmp_path), "--json"]
    done = subprocess.run([sys.executable, "-m", "scenarios.cli", *words], capture_output=True, text=True, check=False)
    assert done.stdout, done.stderr
    results = json.loads(done.stdout)["results"]
    for result in results:
        faults = ", ".join(f"{fault['fault']} {fault['effects']}" for fault in result["faults"])
        bad = [judgement["name"] for judgement in result["judgements"] if not judgement["holds"]]
        print(
            f"\n{result['name']}: worst zero {result['figures']['zero_after_fault_ms']:.0f} ms; {faults}; failed {bad}"
        )
    assert done.returncode == 0, done.stderr
    assert len(results) == len(DROPOUTS)
    assert {judgement["holds"] for result in results for judgement in result["judgements"]} == {True}
    suite = ET.parse(tmp_path / "junit.xml").getroot()
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == (str(len(DROPOUTS)), "0", "0")
