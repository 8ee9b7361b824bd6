"""Branch coverage of the core by the tests that both controllers share: `make -C firmware_sim/c coverage`.

Builds the extension with gcov, loads it in place of the installed one, runs the tests and a part of the twin run.
"""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HOME = ROOT / "firmware_sim" / "c"
# Those that step controllers and nothing else: what starts processes measures nothing here.
STEPPING = (
    "c",
    "test_arming.py",
    "test_commands.py",
    "test_deadlines.py",
    "test_edges.py",
    "test_latches.py",
    "test_corners.py",
    "test_one_mac_a_tick.py",
)
# Branches that no input can take where the code is right, each with what takes it instead: line of code -> why.
ARGUED = {
    "return memcmp(mac, expected, sizeof mac) == 0 && ctl_crc16": "AES and CRC that are right; a wrong AES: tools/spoilt.c",
    "if (inputs->self_test_ok && limits_valid": "limits come valid through the binding; a board's own: tools/spoilt.c",
}
TESTS = [str(ROOT / "tests" / "firmware_sim" / name) for name in STEPPING]


def built(folder: Path) -> Path:
    """The instrumented extension."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.gc*"):
        old.unlink()
    objects = []
    for source in sorted(HOME.glob("*.c")):
        target = folder / f"{source.stem}.o"
        flags = ["-std=c11", "-O0", "--coverage", "-fPIC", f"-I{sysconfig.get_paths()['include']}"]
        subprocess.run(["gcc", *flags, "-c", str(source), "-o", str(target)], check=True, cwd=folder)
        objects.append(str(target))
    made = folder / "_native.so"
    subprocess.run(["gcc", "--coverage", "-shared", *objects, "-lm", "-o", str(made)], check=True, cwd=folder)
    return made


def loaded(path: Path) -> None:
    """Put it in the place of the installed one, which nothing has imported yet."""
    assert "firmware_sim.c.binding" not in sys.modules
    spec = importlib.util.spec_from_file_location("firmware_sim.c._native", path)
    assert spec is not None
    assert spec.loader is not None
    native = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(native)
    sys.modules[spec.name] = native
    import firmware_sim.c

    firmware_sim.c._native = native
    from firmware_sim.c import binding

    binding.why_not = lambda: None


def told(folder: Path) -> str:
    """Lines and branches of each file of the core, and the branches that were not taken."""
    text = ""
    for data in sorted(folder.glob("ctl_*.gcda")):
        command = ["gcov", "-b", "-c", str(data)]
        said = subprocess.run(command, capture_output=True, text=True, check=True, cwd=folder).stdout
        part = next((one for one in said.split("\n\n") if f"{data.stem}.c'" in one.splitlines()[0]), "")
        figures = re.findall(r"(Lines executed|Taken at least once):(\S+) of (\d+)", part)
        text += f"{data.stem}.c  " + ", ".join(f"{what.lower()} {share} of {of}" for what, share, of in figures) + "\n"
        missed = ""
        for line in (folder / f"{data.stem}.c.gcov").read_text().splitlines():
            if re.match(r"\s*[#\d=]+\*?:", line):
                missed = line.split(":", 2)[1].strip() + ": " + line.split(":", 2)[2].strip()
            elif line.startswith("branch") and ("taken 0" in line or "never" in line):
                argued = next((why for code, why in ARGUED.items() if code in missed), None)
                text += f"    {'argued' if argued else 'not taken'} at {missed}{f' ({argued})' if argued else ''}\n"
    return text


def main() -> int:
    """Build, load, run, tell."""
    folder = Path(sys.argv[1]).resolve()
    sys.path.insert(0, str(ROOT))
    loaded(built(folder))
    import pytest

    from tests.safety.table import Scale, printed
    from tests.safety.tools.c import twin

    code = pytest.main(["-q", "-p", "no:cacheprovider", "-p", "no:xdist", *TESTS])
    rows = twin.run(Scale(share=float(sys.argv[2])))
    sys.stdout.write(printed(rows) + "\n")
    return int(code) or int(not all(row.holds for row in rows))


if __name__ == "__main__":
    if len(sys.argv) == 2:
        text = told(Path(sys.argv[1]).resolve())
        sys.stdout.write(text)
        sys.exit(int("not taken" in text))
    sys.exit(main())
