"""Mutation of what decides about safety: a process per mutant; crashes and time-outs counted apart from kills.

A mutant survives if every test that runs through its line still passes. Survivors must be argued, one by one, in
equivalent_mutants.json; an entry there that names no mutant any more fails as well.
"""

from __future__ import annotations

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

from tests.safety.mutants import Mutant, mutants
from tests.safety.table import Row, Scale

ROOT = Path(__file__).parents[2]
EQUIVALENT = Path(__file__).with_name("equivalent_mutants.json")
_DEVICE = ("test_deadlines.py", "test_latches.py", "test_commands.py", "test_frames_and_e2e.py")
# What is mutated, and the tests for lines that run at import, which no test can be seen to run through.
TARGETS: dict[str, tuple[str, ...]] = {
    "firmware_sim/controller.py": _DEVICE,
    "firmware_sim/receive.py": _DEVICE,
    "firmware_sim/faults.py": _DEVICE,
    "firmware_sim/watchdogs.py": _DEVICE,
    "firmware_sim/e2e.py": ("test_frames_and_e2e.py", "test_commands.py"),
    "firmware_sim/secoc.py": ("test_frames_and_e2e.py", "test_secoc.py", "test_commands.py"),
    "hilbridge/core/gate.py": ("test_gate.py",),
    "hilbridge/core/session.py": ("test_session_and_bridge.py",),
    "hilbridge/core/deadline.py": ("test_session_and_bridge.py",),
    "hilbridge/wire/e2e.py": ("test_codec_and_link.py",),
    "hilbridge/wire/secoc.py": ("test_secoc.py",),
}
TESTS = ("tests/firmware_sim", "tests/core", "tests/wire")
QUICK = {
    "firmware_sim/secoc.py": "tests/wire/test_secoc.py",
    "firmware_sim/e2e.py": "tests/firmware_sim/test_frames_and_e2e.py",
    "hilbridge/wire/e2e.py": "tests/wire/test_codec_and_link.py",
}
TIMEOUT_S = 60


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

    Inside a function: the function that is already imported is given its mutated code. A constant of the module: every
    module that has taken it over by name is given the mutated one.
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
    for known, value in list(old.items()):
        if known not in changed and isinstance(value, _PLAIN) and not known.startswith("__"):
            for module in [m for m in sys.modules.values() if vars(m).get(known) is value]:
                delattr(module, known)
            continue
        made = changed.get(known, value)
        if isinstance(value, _PLAIN) and made != value:
            for module in [m for m in sys.modules.values() if vars(m).get(known) is value]:
                setattr(module, known, made)
    return True


_PLAIN = (int, float, str, bytes, tuple, dict, frozenset)


def import_anew(target: str, mutant: Mutant) -> None:
    """Forget all our modules, and have the mutant imported in place of the file."""
    name = target.removesuffix(".py").replace("/", ".")
    ours = ("firmware_sim", "hilbridge", "tests", "test_")
    for module in [known for known in sys.modules if known.startswith(ours) and known not in _KEPT]:
        del sys.modules[module]
    sys.meta_path.insert(0, _Finder(name, ROOT / target, compile(mutant.build(), str(ROOT / target), "exec")))


_KEPT = ("tests", "tests.safety", "tests.safety.mutation", "tests.safety.mutants", "tests.safety.table")


def _take_over(old: dict[str, Any], new: dict[str, Any], module: str) -> None:
    for name, made in new.items():
        there = old.get(name)
        made, there = getattr(made, "fget", made), getattr(there, "fget", there)
        if isinstance(made, FunctionType) and isinstance(there, FunctionType) and made.__module__ == module:
            if made.__code__.co_freevars == there.__code__.co_freevars:
                there.__code__, there.__defaults__ = made.__code__, made.__defaults__
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


def chosen_tests(target: str, mutant: Mutant, known: Baseline) -> list[str]:
    """Tests that run through the mutant's line, quickest first; TARGETS says which where the line runs at import."""
    tests = known.lines.get(target, {}).get(mutant.line, set())
    if not tests:
        tests = {test for test in known.seconds if test.split("::")[0].endswith(TARGETS[target])}
    return sorted(tests, key=lambda test: (known.seconds.get(test, 0.0), test))


class Campaign:
    """A pytest plugin: pytest collects once; then, instead of its own loop, a process per mutant runs chosen items."""

    def __init__(self, cases: list[tuple[str, Mutant, list[str]]], say: bool) -> None:
        self.cases, self.say = cases, say
        self.verdicts: dict[str, list[tuple[str, str]]] = {}
        self.killers: list[str] = []

    def pytest_runtestloop(self, session: Any) -> bool:
        """All mutants."""
        named: dict[str, list[Any]] = {}
        for item in session.items:  # by its own name and by its file's: the quick part names whole files
            named.setdefault(item.nodeid, []).append(item)
            named.setdefault(item.nodeid.split("::")[0], []).append(item)
        for done, (target, mutant, tests) in enumerate(self.cases, 1):
            recent = [test for test in self.killers if test in set(tests)]
            order = dict.fromkeys([*recent, *tests])
            chosen = [item for test in order for item in named.get(test, [])]
            assert chosen, f"no test was collected for {target} {mutant.key}"
            verdict, killer = judge(target, mutant, chosen)
            if killer:  # neighbours fall to the same test
                self.killers = [killer, *(test for test in self.killers if test != killer)][:40]
            self.verdicts.setdefault(verdict, []).append((target, mutant.key))
            if self.say and (verdict in ("survived", "crash", "timeout") or done % 25 == 0):
                print(f"{done}/{len(self.cases)} {verdict}: {target} {mutant.key}", file=sys.__stderr__, flush=True)
        return True


def judge(target: str, mutant: Mutant, items: list[Any]) -> tuple[str, str]:
    """killed, survived, import (it cannot even be imported), crash or timeout, from a process of its own; and the killer."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        _run_in_child(target, mutant, items, writing)
    os.close(writing)
    verdict = _awaited(child)
    killer = os.read(reading, 4096).decode() if verdict == "killed" else ""
    os.close(reading)
    return verdict, killer


def _awaited(child: int) -> str:
    deadline_s = time.monotonic() + TIMEOUT_S
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() > deadline_s:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return "timeout"
        time.sleep(0.002)
    if os.WIFSIGNALED(status):
        return "crash"
    return {0: "survived", 1: "killed", 2: "import", 4: "import"}.get(os.WEXITSTATUS(status), "crash")


def _run_in_child(target: str, mutant: Mutant, items: list[Any], writing: int) -> None:
    code = 70
    try:
        void = os.open(os.devnull, os.O_RDWR)
        for descriptor in (0, 1, 2):
            os.dup2(void, descriptor)
        try:
            patched = install(target, mutant)
        except Exception:  # the mutant cannot even be imported: no test could overlook it
            os._exit(2)
        if patched:
            killer = next((item for item in items if _fails(item)), None)
            if killer is not None:
                os.write(writing, killer.nodeid.encode()[:4096])
            code = int(killer is not None)
        else:
            import pytest

            import_anew(target, mutant)
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


def campaign(cases: list[tuple[str, Mutant, list[str]]], say: bool) -> dict[str, list[tuple[str, str]]]:
    """Verdicts: verdict -> [(target, key)]."""
    import pytest

    plugin = Campaign(cases, say)
    os.chdir(ROOT)
    paths = sorted({test.split("::")[0] for _, _, tests in cases for test in tests})
    with contextlib.redirect_stdout(io.StringIO()):
        pytest.main([*_OPTIONS, "-s", *paths], plugins=[plugin])
    return plugin.verdicts


def run(scale: Scale, targets: tuple[str, ...] = tuple(TARGETS)) -> list[Row]:
    """The full run takes about half an hour; the quick one does a seeded handful."""
    everything = {target: list(mutants((ROOT / target).read_text())) for target in targets}
    argued: dict[str, dict[str, str]] = json.loads(EQUIVALENT.read_text())
    if scale.quick:
        rng = random.Random(scale.seed)
        cases = []
        for target, test in QUICK.items():
            candidates = [m for m in everything[target] if m.key not in argued.get(target, {})]
            cases += [(target, mutant, [test]) for mutant in rng.sample(candidates, 2)]
    else:
        known = baseline()
        cases = [(t, m, chosen_tests(t, m, known)) for t, found in everything.items() for m in found]
    verdicts = campaign(cases, say=not scale.quick)
    count = Counter({verdict: len(found) for verdict, found in verdicts.items()})
    survived = verdicts.get("survived", [])
    unargued = [(target, key) for target, key in survived if key not in argued.get(target, {})]
    keys = {target: {mutant.key for mutant in found} for target, found in everything.items()}
    stale = [(t, k) for t, listed in argued.items() if t in keys for k in listed if k not in keys[t]]
    survived_keys = set(survived)
    refuted = (
        []
        if scale.quick
        else [(t, k) for t, d in argued.items() if t in keys for k in d if (t, k) not in survived_keys]
    )
    for target, key in unargued:
        print(f"survived, not argued: {target} {key}", file=sys.stderr)
    for target, key in stale + refuted:
        print(f"argued equivalent, but gone or killed: {target} {key}", file=sys.stderr)
    figure = (
        f"{len(cases)} mutants: {count['killed']} killed, {count['import']} not importable, {count['timeout']} timed out, "
        f"{count['crash']} crashed, {len(survived) - len(unargued)} argued equivalent, {len(unargued)} unargued"
    )
    holds = not unargued and not stale and not refuted and count["crash"] == 0
    what = "a seeded handful" if scale.quick else f"all of {len(targets)} files"
    return [Row("mutation", f"{what}, a process each: killed or argued", figure, holds)]
