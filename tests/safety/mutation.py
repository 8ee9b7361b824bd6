"""Mutation of what decides about safety: a process per mutant; crashes and time-outs counted apart from kills.

A mutant survives if every test that runs through its line still passes. Survivors must be argued, one by one, in
equivalent_mutants.json; an entry there that names no mutant any more fails as well. What is argued meets the quickest
of its tests where all files are mutated, and all of them where files are named (`--files`).
"""

from __future__ import annotations

import ast
import contextlib
import io
import json
import os
import random
import signal
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

from tests.safety.table import Row, Scale
from tests.safety.tools.baseline import baseline, chosen_tests, quickest
from tests.safety.tools.install import import_anew, install
from tests.safety.tools.mutants import Mutant, mutants

ROOT = Path(__file__).parents[2]
EQUIVALENT = Path(__file__).with_name("equivalent_mutants.json")
_DEVICE = (
    *("test_deadlines.py", "test_latches.py", "test_commands.py", "test_frames_and_e2e.py", "test_edges.py"),
    *("test_receive.py", "test_watchdogs.py", "test_arming.py", "test_disturbed_handshake.py"),
)
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
    "firmware_sim/transmit.py": ("test_transmit.py", "test_node.py", "test_cycles.py", "test_latches.py"),
    "firmware_sim/node.py": ("test_node.py", "test_node_loop.py", "test_node_commands.py", "test_node_process.py"),
    "firmware_sim/attachment.py": ("test_attachment.py", "test_node.py"),
    "firmware_sim/profiles.py": _LAW,
    "firmware_sim/assist_profile.py": (*_LAW, "test_profile_file.py"),
    "firmware_sim/profile_file.py": ("test_profile_file.py",),
    "firmware_sim/states.py": ("test_states.py", "wire/test_conformance.py", "test_latches.py"),
    "firmware_sim/e2e.py": ("test_frames_and_e2e.py", "test_edges.py", "wire/test_conformance.py", "test_receive.py"),
    "firmware_sim/secoc.py": ("test_frames_and_e2e.py", "wire/test_secoc.py", "wire/test_keys.py", "test_commands.py"),
    "hilbridge/core/gate.py": ("core/test_gate.py",),
    "hilbridge/core/session.py": ("core/test_session.py", "core/test_both_ends.py"),
    "hilbridge/core/deadline.py": ("core/test_deadline.py",),
    "hilbridge/core/bridge.py": ("core/test_bridge.py", "core/test_bridge_arming.py", "core/test_both_ends.py"),
    "hilbridge/wire/codec.py": (
        "wire/test_codec.py",
        "wire/test_site_messages.py",
        "wire/test_dbc.py",
        "wire/test_link.py",
    ),
    "hilbridge/wire/dbc.py": ("wire/test_dbc.py", "wire/test_codec.py"),
    "hilbridge/wire/link.py": ("wire/test_link.py",),
    "hilbridge/wire/e2e.py": ("wire/test_e2e.py",),
    "hilbridge/wire/secoc.py": ("wire/test_secoc.py",),
    "hilbridge/wire/keys.py": ("wire/test_keys.py",),
}
QUICK = {
    "firmware_sim/secoc.py": ["tests/wire/test_secoc.py", "tests/wire/test_keys.py"],
    "firmware_sim/e2e.py": ["tests/firmware_sim/test_frames_and_e2e.py", "tests/wire/test_conformance.py"],
    "hilbridge/wire/e2e.py": ["tests/wire/test_e2e.py"],
}
TIMEOUT_S = 60.0
ARGUED_S = 5.0  # of tests for a mutant that is argued, where all files are mutated: all of its tests take up to 240 s
JOBS = os.cpu_count() or 1
CONTROL = "control"
CONTROL_TEST_S, CONTROL_TESTS = 0.1, 60  # controls run as many quick tests, drawn by the seed


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
            quick = set(case.tests[: len(case.tests) // 2 + 1])  # of the slow ones some never end for some mutants
            recent = [test for test in self.killers if test in quick]
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
                text = f"control {case.target} as {case.mutant.place}: {verdict} {killer}"
                print(text, file=sys.__stderr__, flush=True)
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


# plain: this project is a pytest plugin, so pytest would read our modules itself, to rewrite their assertions, past the mutant.
_OPTIONS = (
    *("--assert=plain", "-q", "--no-header", "--tb=no", "--hypothesis-seed=0"),
    *("-p", "no:cacheprovider", "-p", "no:cov", "-p", "no:xdist"),
)


def campaign(cases: list[Case], say: bool) -> Verdicts:
    """Run them all."""
    import pytest
    from hypothesis import Phase, settings

    # A failure is all that is asked for: to look for its smallest example takes longer than the tests themselves.
    settings.register_profile("mutation", phases=(Phase.explicit, Phase.generate), database=None, deadline=None)
    settings.load_profile("mutation")
    plugin = Campaign(cases, say)
    os.chdir(ROOT)
    paths = sorted({test.split("::")[0] for case in cases for test in case.tests})
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        pytest.main([*_OPTIONS, "-s", *paths], plugins=[plugin])
    if sum(map(len, plugin.verdicts.values())) + sum(plugin.controls.values()) != len(cases):
        raise RuntimeError(f"the campaign has ended early:\n{said.getvalue()[-2000:]}")
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
            tests, at_import = chosen_tests(target, mutant, known, TARGETS[target])
            if not scale.files and mutant.key in argued.get(target, {}):
                tests = quickest(tests, known, ARGUED_S)
            alone_s = sum(known.seconds.get(test, 0.0) for test in tests)
            cases.append(Case(target, mutant, tests, at_import, TIMEOUT_S + 10 * alone_s))
    named = {}
    for target in everything:
        tests_of = {test for case in cases if case.target == target for test in case.tests}
        quick = sorted(test for test in tests_of if known.seconds.get(test, 0.0) < CONTROL_TEST_S)
        named[target] = random.Random(scale.seed).sample(quick, min(len(quick), CONTROL_TESTS))
    return [*controls(tuple(everything), named), *cases]


def run(scale: Scale) -> list[Row]:
    """The full run takes about half an hour on two processors; the quick one does a seeded handful."""
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
    listed = [(t, k) for t, d in argued.items() if t in keys for k in d]
    refuted = [] if scale.quick else [entry for entry in listed if entry not in set(survived)]
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
