"""What a user installs: a checked wheel and sdist that run outside the repository, in an environment with nothing else."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PATIENCE_S = 600.0


def run(*command: str | Path, cwd: Path, code: int = 0) -> str:
    """What it printed; what surrounds this test (its interpreter's path, say) is not handed on."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == code, f"{command}: {done.returncode}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sdist, and the wheel that was made of it."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--outdir", folder, ROOT, cwd=folder)
    return folder


@pytest.fixture(scope="module")
def programs(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of programs of an environment that holds the wheel and what it asks for."""
    home = tmp_path_factory.mktemp("environment")
    venv.create(home, with_pip=True)
    place = home / ("Scripts" if sys.platform == "win32" else "bin")
    (wheel,) = built.glob("*.whl")
    run(place / "python", "-m", "pip", "install", "--quiet", "-c", ROOT / "constraints.txt", wheel, cwd=home)
    return place


def test_both_are_what_an_index_takes(built: Path) -> None:
    tools = Path(sys.executable).parent
    assert len(list(built.iterdir())) == 2
    run(sys.executable, "-m", "twine", "check", "--strict", *built.iterdir(), cwd=built)
    run(
        sys.executable,
        "-m",
        "check_wheel_contents",
        "--config",
        ROOT / "pyproject.toml",
        *built.glob("*.whl"),
        cwd=tools,
    )


def test_nothing_of_a_common_name_is_installed_and_no_data_is_missing(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    (sdist,) = built.glob("*.tar.gz")
    held = set(zipfile.ZipFile(wheel).namelist())
    tops = {name.split("/")[0] for name in held if not name.split("/")[0].endswith(".dist-info")}
    assert tops == {"firmware_sim", "hilbridge", "hilscenario"}
    catalog = {path.name for path in (ROOT / "scenarios" / "catalog").glob("*.yaml")}
    assert {Path(name).name for name in held if name.startswith("hilscenario/catalog/")} == catalog
    for kind in ("*.html", "*.dbc", "*.safetensors", "*.c", "*.h", "py.typed"):
        for package in ("firmware_sim", "hilbridge", "scenarios/hilscenario"):
            for path in (ROOT / package).rglob(kind):
                name = str(path.relative_to(ROOT / "scenarios" if "scenarios" in package else ROOT))
                assert name in held or "/port/" in name or "/tools/" in name, name
    with tarfile.open(sdist) as archive:
        assert any(name.endswith("/scenarios/hilscenario/cli.py") for name in archive.getnames())


def test_the_programs_run_from_another_folder(programs: Path, tmp_path: Path) -> None:
    told = json.loads(run(programs / "hilbridge", "demo", "--seconds", "5", "--json", cwd=tmp_path))
    assert Path(tmp_path, told["recording"]).is_file()
    assert told["frames_lost"] == 0
    assert run(programs / "python", "-m", "hilbridge", "--version", cwd=tmp_path).startswith("hilbridge ")
    assert "well" in run(programs / "hilbridge", "doctor", cwd=tmp_path)
    assert "H1" in run(programs / "hilbridge", "docs", "safety", cwd=tmp_path)
    verdict = json.loads(run(programs / "hilscenario", "run", "catalog/bus-cut.yaml", "--json", cwd=tmp_path))
    assert verdict["passed"] is True


STRANGER = """
def test_the_device_hears_the_bridge(simulated_device, bridge):
    summary = bridge.run(seconds=3).summary
    assert summary.ticks > 50
    simulated_device.stop()
    assert simulated_device.summary["received"] > 100


def test_stop_from_any_node(scenario):
    result = scenario("catalog/stop-from-any-node.yaml")
    assert result.robustness >= 0
"""


def test_a_stranger_writes_a_test_in_an_empty_folder(programs: Path, tmp_path: Path) -> None:
    run(programs / "python", "-m", "pip", "install", "--quiet", "-c", ROOT / "constraints.txt", "pytest", cwd=tmp_path)
    (tmp_path / "test_mine.py").write_text(STRANGER)
    told = run(programs / "python", "-m", "pytest", "-q", cwd=tmp_path)
    print(told.splitlines()[-1])
    assert "2 passed" in told
