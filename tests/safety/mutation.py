"""Mutation of what decides about safety: a process per mutant; crashes and time-outs counted apart from kills.

A mutant survives if every test that runs through its line still passes. Survivors must be argued, one by one, in
equivalent_mutants.json; an entry there that names no mutant any more fails as well.
"""

from __future__ import annotations

import ast
import contextlib
import importlib.abc
import importlib.machinery
import io
import json
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

from tests.safety.table import Row, Scale
from tests.safety.tools.mutants import Mutant, mutants

ROOT = Path(__file__).parents[2]
EQUIVALENT = Path(__file__).with_name("equivalent_mutants.json")
_DEVICE = ("test_deadlines.py", "test_latches.py", "test_commands.py", "test_frames_and_e2e.py", "test_edges.py")
_LAW = ("test_torque_vectors.py", "test_torque.py")
LAW = ("allowance", "damping", "filters", "guidance", "memory", "numbers", "support")
# What is mutated, and the tests for lines that run at import, which no test can be seen to run through.
TARGETS: dict[str, tuple[str, ...]] = {
    "firmware_sim/controller.py": _DEVICE,
    "firmware_sim/receive.py": _DEVICE,
    "firmware_sim/transitions.py": _DEVICE,
    "firmware_sim/watchdogs.py": _DEVICE,
    "firmware_sim/torque.py": _LAW,
    **{f"firmware_sim/law/{part}.py": (*_LAW, f"law/test_{part}.py") for part in LAW},
    "firmware_sim/transmit.py": ("test_transmit.py", "test_node.py", "test_latches.py"),
    "firmware_sim/states.py": ("test_states.py", "wire/test_conformance.py", "test_latches.py"),
    "firmware_sim/e2e.py": ("test_frames_and_e2e.py", "test_edges.py", "wire/test_conformance.py", "test_commands.py"),
    "firmware_sim/secoc.py": ("test_frames_and_e2e.py", "wire/test_secoc.py", "wire/test_keys.py", "test_commands.py"),
    "hilbridge/core/gate.py": ("core/test_gate.py",),
    "hilbridge/core/session.py": ("core/test_session.py", "core/test_both_ends.py"),
    "hilbridge/core/deadline.py": ("core/test_deadline.py",),
    "hilbridge/core/bridge.py": ("core/test_bridge.py", "core/test_both_ends.py"),
    "hilbridge/wire/codec.py": ("wire/test_codec.py", "wire/test_dbc.py", "wire/test_link.py"),
    "hilbridge/wire/dbc.py": ("wire/test_dbc.py", "wire/test_codec.py"),
    "hilbridge/wire/link.py": ("wire/test_link.py",),
    "hilbridge/wire/e2e.py": ("wire/test_e2e.py",),
    "hilbridge/wire/secoc.py": ("wire/test_secoc.py",),
    "hilbridge/wire/keys.py": ("wire/test_keys.py",),
}
TESTS = ("tests/firmware_sim", "tests/core", "tests/wire")
QUICK = {
    "firmware_sim/secoc.py": ["tests/wire/test_secoc.py", "tests/wire/test_keys.py"],
    "firmware_sim/e2e.py": ["tests/firmware_sim/test_frames_and_e2e.py", "tests/wire/test_conformance.py"],
    "hilbridge/wire/e2e.py": ["tests/wire/test_e2e.py"],
}
TIMEOUT_S = 60.0
JOBS = os.cpu_count() or 1
CONTROL = "control"
CONTROL_TEST_S, CONTROL_TESTS = 0.1, 60  # controls run as many quick tests, drawn by the seed


class Baseline(NamedTuple):
    """Which tests run through which line of which file, and how long each takes."""

    lines: dict[str, dict[int, set[str]]]
    seconds: dict[str, float]


class _Loader(importlib.abc.Loader):
    def __init__(self, code: CodeType) -> None:
        self.code = code

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        exec(self.code, module.__dict__)  # the mutant, in this process only


class _Finder(importlib.abc.MetaPathFinder):
    """Gives the mutant wherever its module is imported."""

    def __init__(self, name: str, path: Path, code: CodeType) -> None:
        self.name, self.path, self.code = name, path, code

    def find_spec(self, name: str, path: object, target: object = None) -> importlib.machinery.ModuleSpec | None:
        if name != self.name:
            return None
        return importlib.machinery.ModuleSpec(name, _Loader(self.code), origin=str(self.path))


def install(target: str, mutant: Mutant) -> bool:
    """Make the mutant what every test in this process sees; False when that needs all our modules imported anew.

    Inside a function: the function that is already imported is given its mutated code. A plain constant of the module:
    every module that has taken it over by name is given the mutated one.
    """
    if mutant.place == "class":
        return False
    name = target.removesuffix(".py").replace("/", ".")
    changed: dict[str, Any] = {"__name__": name}
    exec(compile(mutant.build(), str(ROOT / target), "exec"), changed)
    old = vars(sys.modules[name])
    if mutant.place == "function":
        _take_over(old, changed, name)
        return True
    differ = {known: value for known, value in old.items() if isinstance(value, _PLAIN) and not known.startswith("__")}
    differ = {known: value for known, value in differ.items() if known not in changed or changed[known] != value}
    if not all(_is_plain(changed.get(known)) for known in differ):
        return False  # it holds members of classes made anew, which nobody else would know again
    for known, value in differ.items():
        for module in [m for m in sys.modules.values() if vars(m).get(known) is value]:
            if known in changed:
                setattr(module, known, changed[known])
            else:
                delattr(module, known)
    return True


def _is_plain(value: object) -> bool:
    if isinstance(value, dict):
        return all(_is_plain(key) and _is_plain(entry) for key, entry in value.items())
    if isinstance(value, (tuple, frozenset)):
        return type(value) in (tuple, frozenset) and all(_is_plain(entry) for entry in value)
    return value is None or type(value) in (bool, int, float, str, bytes)


_PLAIN = (int, float, str, bytes, tuple, dict, frozenset)


def import_anew(target: str, mutant: Mutant) -> None:
    """Forget all our modules, and have the mutant imported in place of the file."""
    name = target.removesuffix(".py").replace("/", ".")
    ours = ("firmware_sim", "hilbridge", "tests", "test_")
    for module in [known for known in sys.modules if known.startswith(ours) and known not in _KEPT]:
        del sys.modules[module]
        package, _, last = module.rpartition(".")
        if package in _KEPT:  # or `from tests.safety import ...` would still find the old one there
            vars(sys.modules[package]).pop(last, None)
    sys.meta_path.insert(0, _Finder(name, ROOT / target, compile(mutant.build(), str(ROOT / target), "exec")))


_KEPT = ("tests", "tests.safety", "tests.safety.mutation", "tests.safety.tools.mutants", "tests.safety.table")


def _take_over(old: dict[str, Any], new: dict[str, Any], module: str) -> None:
    for name, made in new.items():
        there = old.get(name)
        made, there = getattr(made, "fget", made), getattr(there, "fget", there)
        if isinstance(made, FunctionType) and isinstance(there, FunctionType) and made.__module__ == module:
            if made.__code__.co_freevars == there.__code__.co_freevars:
                there.__code__ = made.__code__
        elif isinstance(made, type) and isinstance(there, type) and made.__module__ == module:
            _take_over(dict(vars(there)), dict(vars(made)), module)


def baseline() -> Baseline:
    """Run all tests once, recording per line who runs through it. Raises RuntimeError when they do not pass."""
    from coverage import CoverageData

    with tempfile.TemporaryDirectory() as folder:
        data_file = Path(folder) / "coverage"
        command = [sys.executable, "-m", "pytest", *TESTS, "-q", "-p", "no:cacheprovider", "--cov=firmware_sim"]
        command += ["--cov=hilbridge.core", "--cov=hilbridge.wire", "--cov-context=test", "--cov-report="]
        command += ["--durations=0", "--durations-min=0", "-vv", "--hypothesis-seed=0"]
        environment = os.environ | {"COVERAGE_FILE": str(data_file), "PYTHONPATH": str(ROOT), "COLUMNS": "400"}
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"tests fail without any mutation:\n{done.stdout[-2000:]}")
        seconds: dict[str, float] = {}
        for found in re.finditer(r"^([0-9.]+)s (?:call|setup)\s+(\S.*)$", done.stdout, re.M):
            seconds[found[2].strip()] = seconds.get(found[2].strip(), 0.0) + float(found[1])
        data = CoverageData(str(data_file))
        data.read()
        lines: dict[str, dict[int, set[str]]] = {}
        for name in data.measured_files():
            relative = str(Path(name).relative_to(ROOT))
            lines[relative] = {
                line: {context.split("|")[0] for context in contexts if context}
                for line, contexts in data.contexts_by_lineno(name).items()
            }
    return Baseline(lines, seconds)


def chosen_tests(target: str, mutant: Mutant, known: Baseline) -> tuple[list[str], bool]:
    """Tests that run through the mutant's line, quickest first; TARGETS says which where it runs at import (the flag)."""
    tests = known.lines.get(target, {}).get(mutant.line, set())
    at_import = not tests and mutant.place == "function"
    if not tests:
        tests = {test for test in known.seconds if test.split("::")[0].endswith(TARGETS[target])}
    return sorted(tests, key=lambda test: (known.seconds.get(test, 0.0), test)), at_import


class Case(NamedTuple):
    """A mutant, the tests that may kill it, and whether its line runs at import, so that no running test shows it."""

    target: str
    mutant: Mutant
    tests: list[str]
    at_import: bool = False
    limit_s: float = TIMEOUT_S


class Verdicts(NamedTuple):
    """Verdict -> cases; and the controls: files given to the tests unchanged, of which none may be killed."""

    found: dict[str, list[tuple[str, str]]]
    controls: dict[str, int]


class _Running(NamedTuple):
    case: Case
    reading: int
    deadline_s: float


class Campaign:
    """A pytest plugin: pytest collects once; then, instead of its own loop, a process per mutant runs chosen items."""

    def __init__(self, cases: list[Case], say: bool) -> None:
        self.cases, self.say = cases, say
        self.verdicts: dict[str, list[tuple[str, str]]] = {}
        self.controls: dict[str, int] = {}
        self.killers: list[str] = []
        self._running: dict[int, _Running] = {}
        self._done = 0

    def pytest_runtestloop(self, session: Any) -> bool:
        """All mutants, as many at a time as there are processors."""
        named: dict[str, list[Any]] = {}
        for item in session.items:  # by its own name and by its file's: the quick part names whole files
            named.setdefault(item.nodeid, []).append(item)
            named.setdefault(item.nodeid.split("::")[0], []).append(item)
        for case in self.cases:
            recent = [test for test in self.killers if test in set(case.tests)]
            order = dict.fromkeys([*recent, *case.tests])
            chosen = [item for test in order for item in named.get(test, [])]
            assert chosen, f"no test was collected for {case.target} {case.mutant.key}"
            while len(self._running) >= JOBS:
                self._reap()
            self._start(case, chosen)
        while self._running:
            self._reap()
        return True

    def _start(self, case: Case, items: list[Any]) -> None:
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            os.setpgid(0, 0)
            _run_in_child(case, items, writing)
        os.close(writing)
        self._running[child] = _Running(case, reading, time.monotonic() + case.limit_s)

    def _reap(self) -> None:
        """Take in whoever has ended; end whoever is overdue."""
        for child, running in list(self._running.items()):
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                self._judged(child, _verdict(status))
            elif time.monotonic() > running.deadline_s:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                self._judged(child, "timeout")
        time.sleep(0.002)

    def _judged(self, child: int, verdict: str) -> None:
        case, reading, _ = self._running.pop(child)
        killer = os.read(reading, 4096).decode() if verdict == "killed" else ""
        os.close(reading)
        self._done += 1
        if case.mutant.key == CONTROL:
            if verdict != "survived":
                print(
                    f"control {case.target} as {case.mutant.place}: {verdict} {killer}", file=sys.__stderr__, flush=True
                )
            self.controls[verdict] = self.controls.get(verdict, 0) + 1
        else:
            self.verdicts.setdefault(verdict, []).append((case.target, case.mutant.key))
        if killer:  # neighbours fall to the same test
            self.killers = [killer, *(test for test in self.killers if test != killer)][:40]
        if self.say and (verdict in ("survived", "crash", "timeout") or self._done % 25 == 0):
            text = f"{self._done}/{len(self.cases)} {verdict}: {case.target} {case.mutant.key}"
            print(text, file=sys.__stderr__, flush=True)


def _verdict(status: int) -> str:
    """killed, survived, import (it cannot even be imported) or crash, from how the mutant's process ended."""
    if os.WIFSIGNALED(status):
        return "crash"
    return {0: "survived", 1: "killed", 2: "import", 4: "import"}.get(os.WEXITSTATUS(status), "crash")


def _run_in_child(case: Case, items: list[Any], writing: int) -> None:
    code = 70
    try:
        void = os.open(os.devnull, os.O_RDWR)
        for descriptor in (0, 1, 2):
            os.dup2(void, descriptor)
        try:
            patched = not case.at_import and install(case.target, case.mutant)
        except Exception:  # the mutant cannot even be imported: no test could overlook it
            os._exit(2)
        if patched:
            killer = next((item for item in items if _fails(item)), None)
            if killer is not None:
                os.write(writing, killer.nodeid.encode()[:4096])
            code = int(killer is not None)
        # What was made of a constant at import, here or in another module, only a new import shows.
        if not patched or (code == 0 and case.mutant.place == "module"):
            import pytest

            import_anew(case.target, case.mutant)
            code = int(pytest.main([*_OPTIONS, "-x", *(item.nodeid for item in items)]))
    finally:
        os._exit(code)


def _fails(item: Any) -> bool:
    from _pytest.runner import runtestprotocol

    return any(report.failed for report in runtestprotocol(item, log=False, nextitem=None))


_OPTIONS = (
    "-q",
    "--no-header",
    "--tb=no",
    "-p",
    "no:cacheprovider",
    "-p",
    "no:cov",
    "-p",
    "no:xdist",
    "--hypothesis-seed=0",
)


def campaign(cases: list[Case], say: bool) -> Verdicts:
    """Run them all."""
    import pytest

    plugin = Campaign(cases, say)
    os.chdir(ROOT)
    paths = sorted({test.split("::")[0] for case in cases for test in case.tests})
    with contextlib.redirect_stdout(io.StringIO()):
        pytest.main([*_OPTIONS, "-s", *paths], plugins=[plugin])
    return Verdicts(plugin.verdicts, plugin.controls)


def controls(targets: tuple[str, ...], tests: dict[str, list[str]]) -> list[Case]:
    """Each file as it is, installed in every way a mutant is: a harness that kills these kills for another reason."""
    cases = []
    for target in targets:
        tree = ast.parse((ROOT / target).read_text())
        for place in ("function", "module", "class"):
            cases.append(Case(target, Mutant(CONTROL, 0, lambda tree=tree: tree, place), tests[target], limit_s=600.0))  # type: ignore[misc]
    return cases


def _cases(everything: dict[str, list[Mutant]], argued: dict[str, dict[str, str]], scale: Scale) -> list[Case]:
    if scale.quick:
        rng, cases = random.Random(scale.seed), []
        for target, tests in QUICK.items():
            candidates = [m for m in everything[target] if m.key not in argued.get(target, {})]
            cases += [Case(target, mutant, tests) for mutant in rng.sample(candidates, 2)]
        return [*controls(tuple(QUICK), QUICK), *cases]
    known = baseline()
    cases = []
    for target, found in everything.items():
        for mutant in found:
            tests, at_import = chosen_tests(target, mutant, known)
            alone_s = sum(known.seconds.get(test, 0.0) for test in tests)
            cases.append(Case(target, mutant, tests, at_import, TIMEOUT_S + 10 * alone_s))
    named = {}
    for target in everything:
        tests_of = {test for case in cases if case.target == target for test in case.tests}
        quick = sorted(test for test in tests_of if known.seconds.get(test, 0.0) < CONTROL_TEST_S)
        named[target] = random.Random(scale.seed).sample(quick, min(len(quick), CONTROL_TESTS))
    return [*controls(tuple(everything), named), *cases]


def run(scale: Scale) -> list[Row]:
    """The full run takes about a quarter of an hour on two processors; the quick one does a seeded handful."""
    targets = scale.files or tuple(TARGETS)
    everything = {target: list(mutants((ROOT / target).read_text())) for target in targets}
    argued: dict[str, dict[str, str]] = json.loads(EQUIVALENT.read_text())
    cases = _cases(everything, argued, scale)
    verdicts, control = campaign(cases, say=not scale.quick)
    count = Counter({verdict: len(found) for verdict, found in verdicts.items()})
    # A mutant that never ends is argued like one that survives: nothing has failed because of it.
    survived = verdicts.get("survived", []) + verdicts.get("timeout", [])
    unargued = [(target, key) for target, key in survived if key not in argued.get(target, {})]
    keys = {target: {mutant.key for mutant in found} for target, found in everything.items()}
    stale = [(t, k) for t, listed in argued.items() if t in keys for k in listed if k not in keys[t]]
    survived_keys = set(survived)
    listed = [(t, k) for t, d in argued.items() if t in keys for k in d]
    refuted = [] if scale.quick else [entry for entry in listed if entry not in survived_keys]
    for target, key in unargued:
        print(f"survived, not argued: {target} {key}", file=sys.stderr)
    for target, key in stale + refuted:
        print(f"argued equivalent, but gone or killed: {target} {key}", file=sys.stderr)
    figure = (
        f"{sum(count.values())} mutants: {count['killed']} killed, {count['import']} not importable, "
        f"{count['timeout']} timed out, {count['crash']} crashed, {len(survived) - len(unargued)} argued, "
        f"{len(unargued)} unargued"
    )
    holds = not unargued and not stale and not refuted and count["crash"] == 0
    what = "a seeded handful" if scale.quick else f"all of {len(targets)} files"
    alive = control.get("survived", 0)
    return [
        Row("mutation", f"{what}, a process each: killed or argued", figure, holds),
        Row(
            "mutation",
            "controls: unchanged files, installed in every way: none killed",
            f"{alive} of {sum(control.values())} survive",
            alive == sum(control.values()) > 0,
        ),
    ]
