"""The plugin in folders of its own, each run by a pytest of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

GOOD = """
name: within its cap
duration: 4 s
seed: 3
intent:
  - {at: 1 s, verb: Pour, confidence: 0.97}
expect:
  - {that: "always device.assist_nm < 3"}
"""
BAD = GOOD.replace("within its cap", "too strict").replace("< 3", "< 0.01")
PYTHON = """
def test_fine(scenario):
    assert scenario("fine.hil.yaml").passed

def test_mapping(scenario):
    scenario({
        "name": "of a mapping", "duration": "4 s", "seed": 3,
        "intent": [{"at": "1 s", "verb": "Pour", "confidence": 0.97}],
        "expect": [{"that": "always device.assist_nm < 0.01"}],
    })

def test_bus(hil_bus):
    assert hil_bus.startswith("hilsim:")
"""


def run(folder: Path, *arguments: str) -> tuple[int, str]:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:randomly", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    return done.returncode, done.stdout + done.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("stranger")
    (made / "fine.hil.yaml").write_text(GOOD)
    (made / "bad.hil.yaml").write_text(BAD)
    (made / "unreadable.hil.yaml").write_text(GOOD.replace("seed: 3", "sede: 3"))
    (made / "test_mine.py").write_text(PYTHON)
    return made


def test_a_scenario_that_holds_is_a_test_that_passes(folder: Path) -> None:
    code, told = run(folder, "fine.hil.yaml")
    assert (code, "1 passed" in told) == (0, True), told


def test_a_failure_says_formula_margin_when_picture_and_command(folder: Path) -> None:
    code, told = run(folder, "bad.hil.yaml")
    assert code == 1, told
    assert "violated: always device.assist_nm < 0.01" in told
    assert "margin -0." in told
    assert " ms" in told
    assert f"repeat: hilscenario run {folder / 'bad.hil.yaml'} --seed 3" in told
    # once, or in CI, where pytest does not shorten its summary, twice
    (picture,) = {line.removeprefix("picture: ") for line in told.splitlines() if line.startswith("picture: ")}
    assert "<svg" in Path(picture).read_text(encoding="utf-8")
    assert "Traceback" not in told


def test_a_file_that_is_no_scenario_is_one_line(folder: Path) -> None:
    code, told = run(folder, "unreadable.hil.yaml")
    assert code == 2
    assert "unreadable.hil.yaml:4: " in told
    assert "`seed`" in told


def test_the_fixtures_work_on_several_workers(folder: Path) -> None:
    code, told = run(folder, "-n", "2", "test_mine.py", "fine.hil.yaml")
    assert code == 1
    assert "3 passed" in told, told
    assert "1 failed" in told
    (repeat,) = {line.split("run ")[1].split()[0] for line in told.splitlines() if "repeat: hilscenario" in line}
    assert "of a mapping" in Path(repeat).read_text(encoding="utf-8")


def test_unused_it_imports_nothing_of_ours(tmp_path: Path) -> None:
    (tmp_path / "test_other.py").write_text(
        "import sys\n\ndef test_it():\n"
        "    ours = {n for n in sys.modules if n.split('.')[0] in ('hilbridge', 'firmware_sim', 'hilscenario')}\n"
        "    assert ours == {'hilscenario', 'hilscenario.pytest_plugin'}\n"
        "    assert not {'numpy', 'yaml', 'can', 'pydantic'} & set(sys.modules)\n"
    )
    code, told = run(tmp_path, "-p", "no:hypothesispytest", "-p", "no:jaxtyping", "test_other.py")
    assert code == 0, told


def test_modules_of_ours_are_loaded_as_they_are(tmp_path: Path) -> None:
    (tmp_path / "test_other.py").write_text(
        "import importlib.machinery, hilbridge.demo, hilscenario.pytest_bridge, sys\n\ndef test_it():\n"
        "    for name in ('hilbridge.demo', 'hilscenario.pytest_bridge', 'hilbridge.rows'):\n"
        "        assert type(sys.modules[name].__spec__.loader) is importlib.machinery.SourceFileLoader\n"
    )
    code, told = run(tmp_path, "test_other.py")
    assert code == 0, told
