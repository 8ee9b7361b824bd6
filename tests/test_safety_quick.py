"""The quick, seeded part of `make safety`, in every test run. The full parts are `python -m tests.safety`."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.safety import campaign, checking, harm
from tests.safety.mutation import ROOT
from tests.safety.server import run as server
from tests.safety.table import Row, Scale, printed
from tests.safety.tools import planted
from tests.safety.tools.baseline import Baseline, chosen_tests, quickest
from tests.safety.tools.mutants import Mutant
from tests.safety.wire import corruption, forgery, fuzz, replay

requirement = pytest.mark.requirement
QUICK = Scale(quick=True)


def all_hold(rows: list[Row]) -> None:
    assert all(row.holds for row in rows), "\n" + printed(rows)


@requirement("P1", "P2")
def test_h9_corruption() -> None:
    all_hold(corruption.run(QUICK))


@requirement("P6", "P7", "P8")
def test_h2_replay_and_queue() -> None:
    all_hold(replay.run(QUICK))


@requirement("P6", "S6")
def test_h1_forgery() -> None:
    all_hold(forgery.run(QUICK))


@requirement("S1", "T1", "T2", "T3")
def test_h2_model_checking_sample() -> None:
    all_hold(checking.run(QUICK))


@requirement("T11", "T12", "T8", "T9")
def test_h1_h4_h5_harm_sample() -> None:
    all_hold(harm.run(QUICK))


@requirement("P9", "P8")
def test_h9_fuzz() -> None:
    all_hold(fuzz.run(QUICK))


@requirement("T1", "T2", "T3")
@pytest.mark.slow
def test_h1_h2_fault_campaign_sample() -> None:
    all_hold(campaign.run(QUICK))


@pytest.mark.slow
def test_mutation_sample() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.safety", "mutation", "--quick"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_mutant_meets_the_tests_that_look_at_its_line() -> None:
    a, b, c = "tests/core/test_gate.py::test_a", "tests/core/test_gate.py::test_b", "tests/wire/test_e2e.py::test_c"
    known = Baseline({"gate.py": {7: {c}}}, {a: 3.0, b: 1.0, c: 2.0})
    in_function, of_module = Mutant("m", 7, list, "function"), Mutant("m", 7, list, "module")
    assert chosen_tests("gate.py", in_function, known, ("core/test_gate.py",)) == ([c], False)
    assert chosen_tests("gate.py", of_module, known, ("core/test_gate.py",)) == ([b, c, a], False)
    assert chosen_tests("gate.py", in_function._replace(line=8), known, ("core/test_gate.py",)) == ([b, a], True)
    assert quickest([b, c, a], known, 3.0) == [b, c]
    assert quickest([a], known, 1.0) == [a]


@requirement("P9")
@pytest.mark.slow
def test_h9_simulated_bus_under_attack_sample() -> None:
    all_hold(server.run(QUICK))


@requirement("P13", "T1")
@pytest.mark.slow
def test_h2_hung_bridge_sample() -> None:
    command = [sys.executable, "-m", "tests.safety", "hung", "--quick", "--bus", "hilsim"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_planted_defects_sample() -> None:
    all_hold(planted.run(QUICK))


def test_every_planted_defect_has_its_place_and_its_test() -> None:
    table = planted.table()
    assert len(table) == len({entry.what for entry in table}) == 60
    for entry in table:
        assert (ROOT / entry.file).read_text(encoding="utf-8").count(entry.old) == 1, entry
        file, _, name = entry.test.partition("::")
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8"), entry
