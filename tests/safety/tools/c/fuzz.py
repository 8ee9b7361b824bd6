"""libFuzzer on the C controller under ASan and UBSan: ten million inputs, each some ticks with frames right and wrong."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from tests.safety.table import Row, Scale

HOME = Path(__file__).resolve().parents[4] / "firmware_sim" / "c"
_RUNS = 10_000_000


def run(scale: Scale) -> list[Row]:
    """So many inputs; without clang that is said and does not hold."""
    claim = "no input makes the C do what C does not define, or read beyond its memory"
    if shutil.which("clang") is None:
        return [Row("fuzz_c", claim, "clang is not installed", False)]
    runs = scale.of(_RUNS, 20_000)
    with tempfile.TemporaryDirectory() as folder:
        command = ["make", "-s", "-C", str(HOME), "fuzz", f"OUT={folder}", f"RUNS={runs}"]
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
    said = ended.stdout + ended.stderr
    found = re.search(r"stat::number_of_executed_units:\s*(\d+)", said)
    done = int(found[1]) if found else 0
    why = next((line for line in said.splitlines() if "ERROR" in line or "runtime error" in line), "")
    return [Row("fuzz_c", claim, f"{done} inputs {why}".rstrip(), ended.returncode == 0 and done >= runs)]
