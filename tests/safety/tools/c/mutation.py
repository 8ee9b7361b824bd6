"""Mutants of the C controller: each compiled into an extension of its own and driven through sequences of the twin run.

A mutant is killed where a number differs, where it crashes or hangs, and where a vector of AES is wrong. Survivors of that go
through the fuzzer with its sanitizers, since a step beyond an array often changes no number, then through the tests that both
controllers share. Who survives these, too, must be argued in equivalent_c_mutants.json.
"""

from __future__ import annotations

import importlib.util
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections import Counter
from pathlib import Path

from firmware_sim.memory import Refusal
from firmware_sim.states import Reason, State
from tests.safety.table import Row, Scale
from tests.safety.tools.c.mutants import CMutant, mutants
from tests.safety.tools.c.traces import Trace, is_other, taken

ROOT = Path(__file__).resolve().parents[4]
HOME = ROOT / "firmware_sim" / "c"
EQUIVALENT = Path(__file__).resolve().parents[2] / "equivalent_c_mutants.json"
FILES = tuple(sorted(path.name for path in HOME.glob("ctl_*.c") if path.name != "ctl_tables.c"))
_FLAGS = ("-std=c11", "-O1", "-w", "-fPIC", f"-I{sysconfig.get_paths()['include']}", f"-I{HOME}")
_TRACES_S, _TESTS_S, _SANITIZED_S = 60.0, 400.0, 120.0
_SEQUENCES = 300
_SEED = 7
_ENDED = {0: "alive", 3: "killed"}
_SANITIZED_RUNS = 5_000
_TESTS = (
    "c/test_twin_at_bounds.py", "c/test_crypto.py", "test_corners.py", "test_one_mac_a_tick.py", "test_receive.py",
    "test_arming.py", "test_commands.py", "test_edges.py", "test_latches.py", "test_transmit.py", "test_torque.py",
    "test_disturbed_pair.py", "c/test_twin.py", "test_deadlines.py", "test_disturbed_handshake.py",
)  # fmt: skip
KILLED = 3
# The mutant takes the extension's place before anything imports that: later it would be the right one that is tested.
PROVES = """
import sys
sys.path.insert(0, {root!r})
from pathlib import Path
from tests.tools.c_coverage import loaded
loaded(Path({made!r}))
import pytest
code = pytest.main(["-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist", "-k", "c and not python", *{names!r}])
sys.exit({killed} if code else 0)
"""


def _compared(made: Path, traces: list[Trace]) -> int:
    """The same, by the traces."""
    spec = importlib.util.spec_from_file_location("firmware_sim.c._native", made)
    assert spec is not None
    assert spec.loader is not None
    native = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(native)
    native.use_members(tuple(State), tuple(Reason), tuple(Refusal))
    key, block = bytes(range(16)), bytes.fromhex("00112233445566778899aabbccddeeff")
    wrong = native.aes128(key, block).hex() != "69c4e0d86a7b0430d8cdb78070b4c55a"
    return KILLED if wrong or is_other(native.Controller, traces) else 0


def built(name: str, mutant: CMutant, folder: Path, objects: dict[str, Path]) -> Path | None:
    """The extension with this one file in place of the right one; None where it does not compile."""
    source, changed, made = folder / name, folder / "mutant.o", folder / "_native.so"
    source.write_text(mutant.source, encoding="utf-8")
    compiled = subprocess.run(
        ["gcc", *_FLAGS, f"-iquote{HOME}", "-c", str(source), "-o", str(changed)], capture_output=True, check=False
    )
    if compiled.returncode:
        return None
    others = [str(path) for one, path in objects.items() if one != name]
    subprocess.run(["gcc", "-shared", *others, str(changed), "-o", str(made)], check=True, capture_output=True)
    return made


def by_traces(made: Path | None, traces: list[Trace]) -> str:
    """killed, crashed, hung or alive, in a process of its own; not compiled where nothing was made."""
    if made is None:
        return "not compiled"
    child = os.fork()
    if child == 0:
        code = 1
        try:
            code = _compared(made, traces)
        finally:
            os._exit(code)
    ends_s = time.monotonic() + _TRACES_S
    while time.monotonic() < ends_s:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return _ENDED.get(os.waitstatus_to_exitcode(status), "crashed")
        time.sleep(0.005)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "hung"


def by_tests(made: Path) -> str:
    """The same, by the tests."""
    names = [str(ROOT / "tests" / "firmware_sim" / name) for name in _TESTS]
    code = PROVES.format(root=str(ROOT), made=str(made), names=names, killed=KILLED)
    words = [sys.executable, "-c", code]
    try:
        ended = subprocess.run(words, capture_output=True, timeout=_TESTS_S, check=False, cwd=ROOT)
    except subprocess.TimeoutExpired:
        return "hung"
    return _ENDED.get(ended.returncode, "crashed")


def is_undefined(name: str, mutant: CMutant, folder: Path) -> bool:
    """Whether the sanitizers object to the mutant: memory that is not its own, arithmetic that C does not define."""
    source, fuzzer = folder / name, folder / "fuzz"
    source.write_text(mutant.source, encoding="utf-8")
    others = [str(path) for path in sorted(HOME.glob("ctl_*.c")) if path.name != name]
    words = ["clang", "-std=c11", "-O1", "-w", "-fsanitize=fuzzer,address,undefined", "-fno-sanitize-recover=all"]
    words += [f"-I{HOME}", str(source), *others, str(HOME / "tools" / "fuzz.c"), "-o", str(fuzzer)]
    if shutil.which("clang") is None or subprocess.run(words, capture_output=True, check=False).returncode:
        return False
    try:
        told = subprocess.run(
            [str(fuzzer), f"-runs={_SANITIZED_RUNS}", "-max_len=80", "-seed=1"],
            capture_output=True,
            timeout=_SANITIZED_S,
            check=False,
            cwd=folder,
        )
    except subprocess.TimeoutExpired:
        return False
    return told.returncode != 0


def run(scale: Scale) -> list[Row]:
    """All mutants, or a share of them drawn by the seed."""
    known = json.loads(EQUIVALENT.read_text(encoding="utf-8"))
    everything = [(name, one) for name in FILES for one in mutants((HOME / name).read_text(encoding="utf-8"))]
    keys = {f"{name} {one.key}" for name, one in everything}
    chance = random.Random(scale.seed)
    count = min(len(everything), scale.of(len(everything), 20))
    drawn = chance.sample(everything, count) if count < len(everything) else everything
    fates: Counter[str] = Counter()
    survivors: list[str] = []
    traces = taken(scale.of(_SEQUENCES, 40), _SEED)
    with tempfile.TemporaryDirectory() as folder:
        objects = _objects(Path(folder))
        control = by_traces(built(FILES[0], right(FILES[0]), Path(folder), objects), traces)
        for name, one in drawn:
            key = f"{name} {one.key}"
            if key in known:
                fates["argued"] += 1
                continue
            made = built(name, one, Path(folder), objects)
            end = by_traces(made, traces)
            if end == "alive" and is_undefined(name, one, Path(folder)):
                end = "undefined"
            if made is not None and end == "alive":
                end = by_tests(made)
            fates[end] += 1
            if end == "alive":
                survivors.append(f"{key} (line {one.line})")
                print(f"survives: {survivors[-1]}", file=sys.stderr, flush=True)
    told = f"{len(drawn)} of {len(everything)}: " + ", ".join(
        f"{number} {end}" for end, number in sorted(fates.items())
    )
    return [
        Row("mutation_c", "every mutant of the C is killed or argued", told, not survivors),
        Row("mutation_c", "control: the C as it is", control, control == "alive"),
        Row("mutation_c", "every argument is of a mutant that is there", f"{len(known)} argued", known.keys() <= keys),
    ]


def right(name: str) -> CMutant:
    """The file as it is."""
    return CMutant("control", 0, (HOME / name).read_text(encoding="utf-8"))


def _objects(folder: Path) -> dict[str, Path]:
    made = {}
    for source in sorted(HOME.glob("*.c")):
        made[source.name] = folder / f"right-{source.stem}.o"
        subprocess.run(["gcc", *_FLAGS, "-c", str(source), "-o", str(made[source.name])], check=True)
    return made
