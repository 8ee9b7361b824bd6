"""The rooms and their doors: no circle anywhere, each room imports its own few, each command loads only what it needs."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.tools.import_graph import between_children, build, cycle

GRAPH = build()
GROUND = {
    "cluster",
    "records",
    "rows",
    "verbs",
    "errors",
    "priority",
    "limits",
    "lease",
    "guard",
    "files",
    "confidence",
}

# Room -> what it may import beside the ground and itself.
MAY_IMPORT: dict[str, set[str]] = {
    **{room: set() for room in GROUND},
    "core": set(),
    "wire": set(),
    "features": set(),
    "intent": {"features"},
    "config": set(),
    "bus": {"wire"},
    "sensors": set(),
    "wearer": {"core"},
    "runtime": {"bus", "config", "core", "features", "intent", "sensors", "wearer", "wire"},
    "learning": {"core", "features", "intent", "sensors", "wearer"},
    "observe": {"core", "features", "sensors", "wire"},
    "labels": {"observe"},
    "monitor": {"bus", "intent", "observe", "wire"},
    "run": {"config", "labels", "observe", "runtime"},
    "exchange": {"bus", "features", "intent", "observe", "wire"},
    "people": {"core", "features", "intent", "labels", "learning", "observe", "sensors", "wearer"},
    "check": {"doctor_sensors", "runtime"},
    "doctor": {"bus", "config", "core", "doctor_sensors", "intent", "observe", "sensors", "wire"},
    "doctor_sensors": {"sensors"},
    "replay": {"config", "core", "features", "intent", "observe", "runtime", "sensors"},
    "cli_run": {"check", "config", "doctor", "labels", "run", "runtime", "terminal"},
    "align": {"config", "observe"},
    "cli_record": {"cli_shared", "align", "labels", "observe", "replay", "terminal"},
    "demo": {"bus", "config", "core", "observe", "run", "runtime", "wearer"},
    "terminal": {"core", "doctor", "observe", "run", "runtime"},
    "conformance": {"intent", "bus", "config", "core", "runtime", "wire"},
    "cli_bus": {"bus", "cli_shared", "config", "conformance", "intent", "monitor", "runtime", "wire"},
    "api": {"bus", "config", "features", "intent", "observe", "runtime", "sensors", "wire"},
    "cli_examples": set(),
    "cli_shared": set(),
    "entry": set(),
    "cli_exchange": {"exchange", "intent", "terminal"},
    "cli_learning": {"wearer", "intent", "learning", "people", "terminal"},
    "cli_tune": {"terminal", "tune"},
    "tune": {"config", "features", "intent", "learning", "observe", "people", "sensors"},
    "bench": {"bench_prediction", "bus", "core", "intent", "observe", "runtime", "wire"},
    "bench_prediction": {"exchange", "features", "intent", "learning"},
}
SUBROOMS: dict[str, dict[str, set[str]]] = {
    "hilbridge.bus": {
        "model": set(),
        "quick_can": set(),
        "simulated": {"model", "quick_can"},
        "port": {"model", "quick_can", "simulated"},
        "analysis": {"model", "message_set"},
        "message_set": {"model"},
        "candump_text": {"quick_can"},
        "trc_text": {"quick_can"},
        "mf4_batches": {"quick_can"},
        "logs": {"candump_text", "mf4_batches", "quick_can", "trc_text"},
        "diagnosis": {"model", "port", "logs"},
    },
    "hilbridge.learning": {
        "metrics": set(),
        "data": {"metrics"},
        "calibrators": set(),
        "training": {"calibrators", "data", "metrics"},
        "certificate": {"data", "metrics", "training"},
        "experiments": {"calibrators", "certificate", "data", "metrics", "training"},
    },
    "hilscenario": {
        "signals": set(),
        "format": {"signals"},
        "world": {"format", "signals"},
        "verdict": {"format", "signals", "world"},
        "lockstep": {"format", "signals", "verdict", "world"},
        "live": {"format", "signals", "verdict", "world"},
        "twins": set(),
        "benefit": {"format", "lockstep", "twins", "world"},
        "runner": {"format", "live", "lockstep", "signals", "verdict", "world"},
        "campaign": {"format", "lockstep", "runner", "signals", "verdict", "world"},
        "minimise": {"format", "lockstep", "runner", "signals", "verdict", "world"},
    },
}
PACKAGES = sorted(module for module in GRAPH.modules if GRAPH.find_children(module))


def _names(modules: set[str]) -> set[str]:
    return {module.rpartition(".")[2] for module in modules}


@pytest.mark.parametrize("package", PACKAGES)
def test_no_package_has_a_circle_among_its_children(package: str) -> None:
    assert cycle(between_children(GRAPH, package)) == []


def test_rooms_import_only_what_they_may() -> None:
    wrong = {}
    for child, imported in between_children(GRAPH, "hilbridge").items():
        room = child.rpartition(".")[2]
        if room not in ("cli", "__main__"):
            wrong[room] = _names(imported) - MAY_IMPORT[room] - GROUND
    assert {room: extra for room, extra in wrong.items() if extra} == {}


@pytest.mark.parametrize("package", SUBROOMS)
def test_rooms_within_a_room_import_only_what_they_may(package: str) -> None:
    allowed = SUBROOMS[package]
    wrong = {}
    for child, imported in between_children(GRAPH, package).items():
        room = child.rpartition(".")[2]
        if room in allowed:
            wrong[room] = _names(imported) - allowed[room]
    assert {room: extra for room, extra in wrong.items() if extra} == {}
    assert set(allowed) <= _names(set(GRAPH.find_children(package)))


# Packages that a command may load for its work; the last is what a person waits for.
LIGHT = {"numpy", "can", "cantools", "cv2", "mcap"}
HEAVY = {
    "torch",
    "sklearn",
    "mediapipe",
    "ray",
    "distributed",
    "hilbridge.learning",
    "hilscenario",
    "firmware_sim",
}

_LOADED = """
import json, sys
sys.argv = ["program", *sys.argv[2:]]
from {module} import main
try:
    main()
except SystemExit:
    pass
names = set(sys.modules)
print(json.dumps(sorted(names)))
"""


def _loaded(module: str, *arguments: str, tmp_path: Path) -> set[str]:
    """What a fresh process of a program has imported when it ends."""
    done = subprocess.run(
        [sys.executable, "-c", _LOADED.format(module=module), "-", *arguments],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
        timeout=300,
    )
    names: list[str] = json.loads(done.stdout.splitlines()[-1])
    return set(names)


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["evaluate", "--help"]])
def test_help_loads_no_library(arguments: list[str], tmp_path: Path) -> None:
    assert _loaded("hilbridge.cli", *arguments, tmp_path=tmp_path) & (LIGHT | HEAVY) == set()


@pytest.mark.parametrize(
    ("arguments", "without"),
    [
        (["run", "--camera", "absent.mp4", "--gaze", "absent.csv"], {"matplotlib"}),
        (["report", "absent.mcap"], {"matplotlib", "can", "cantools", "cv2", "scipy"}),
        (["bus-analysis", "absent.dbc"], {"matplotlib", "cv2", "scipy", "mcap"}),
        (["data", "describe", "absent"], {"matplotlib", "can", "cantools"}),
    ],
)
def test_commands_load_what_they_need_and_nothing_for_training(
    arguments: list[str], without: set[str], tmp_path: Path
) -> None:
    heavy = HEAVY - ({"hilbridge.learning"} if arguments[0] == "data" else set())
    assert _loaded("hilbridge.cli", *arguments, tmp_path=tmp_path) & (heavy | without) == set()


def test_the_device_loads_nothing_of_the_bridge_but_its_bus(tmp_path: Path) -> None:
    loaded = _loaded("firmware_sim.node", "--help", tmp_path=tmp_path)
    assert {name for name in loaded if name.split(".")[0] in ("hilbridge", "hilscenario", "torch", "cv2")} == set()


def test_scenarios_load_nothing_for_training(tmp_path: Path) -> None:
    assert (
        _loaded("hilscenario.cli", "--help", tmp_path=tmp_path)
        & {"torch", "sklearn", "mediapipe", "hilbridge.learning"}
        == set()
    )
