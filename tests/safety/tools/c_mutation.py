"""Mutants of the C controller: each compiled into an extension of its own and held against the reference by the twin run.

A mutant is killed where a number differs, where it crashes or hangs, and where a vector of AES is wrong. Survivors of that go
through the tests that both controllers share. Who survives these, too, must be argued in equivalent_c_mutants.json.
"""

from __future__ import annotations

import json
import random
import subprocess
import sys
import sysconfig
import tempfile
from collections import Counter
from pathlib import Path

from tests.safety.table import Row, Scale
from tests.safety.tools.c_mutants import CMutant, mutants

ROOT = Path(__file__).resolve().parents[3]
HOME = ROOT / "firmware_sim" / "c"
EQUIVALENT = Path(__file__).resolve().parents[1] / "equivalent_c_mutants.json"
FILES = tuple(sorted(path.name for path in HOME.glob("ctl_*.c") if path.name != "ctl_tables.c"))
_FLAGS = ("-std=c11", "-O1", "-w", "-fPIC", f"-I{sysconfig.get_paths()['include']}", f"-I{HOME}")
_TWIN_S, _TESTS_S = 60.0, 400.0
_TESTS = ("c/test_crypto.py", "test_corners.py", "test_arming.py", "test_commands.py", "test_deadlines.py", "test_edges.py",
          "test_latches.py")  # fmt: skip
PROVES = """
import sys
sys.path.insert(0, {root!r})
from tests.safety.tools.c_mutation import judge
sys.exit(judge({made!r}, {how!r}))
"""
KILLED = 3


def judge(made: str, how: str) -> int:
    """In a process of its own, with the mutant in the extension's place: KILLED, or 0."""
    from tests.tools.c_coverage import loaded

    loaded(Path(made))
    if how == "twin":
        from tests.safety.tools.twin import quick_difference

        return KILLED if _wrong_vectors() or quick_difference() is not None else 0
    import pytest

    names = [str(ROOT / "tests" / "firmware_sim" / name) for name in _TESTS]
    code = pytest.main(["-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist", "-k", "c and not python", *names])
    return KILLED if code else 0


def _wrong_vectors() -> bool:
    from firmware_sim.c import _native

    key, block = bytes(range(16)), bytes.fromhex("00112233445566778899aabbccddeeff")
    return bool(_native.aes128(key, block).hex() != "69c4e0d86a7b0430d8cdb78070b4c55a")


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


def fate(made: Path, how: str, limit_s: float) -> str:
    """killed, crashed, hung or alive."""
    words = [sys.executable, "-c", PROVES.format(root=str(ROOT), made=str(made), how=how)]
    try:
        ended = subprocess.run(words, capture_output=True, timeout=limit_s, check=False, cwd=ROOT)
    except subprocess.TimeoutExpired:
        return "hung"
    return {0: "alive", KILLED: "killed"}.get(ended.returncode, "crashed")


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
    with tempfile.TemporaryDirectory() as folder:
        objects = _objects(Path(folder))
        for name, one in drawn:
            key = f"{name} {one.key}"
            if key in known:
                fates["argued"] += 1
                continue
            made = built(name, one, Path(folder), objects)
            end = "not compiled" if made is None else fate(made, "twin", _TWIN_S)
            if made is not None and end == "alive":
                end = fate(made, "tests", _TESTS_S)
            fates[end] += 1
            if end == "alive":
                survivors.append(f"{key} (line {one.line})")
                print(f"survives: {survivors[-1]}", file=sys.stderr, flush=True)
    told = f"{len(drawn)} of {len(everything)}: " + ", ".join(
        f"{number} {end}" for end, number in sorted(fates.items())
    )
    return [
        Row("mutation_c", "every mutant of the C is killed or argued", told, not survivors),
        Row("mutation_c", "every argument is of a mutant that is there", f"{len(known)} argued", known.keys() <= keys),
    ]


def _objects(folder: Path) -> dict[str, Path]:
    made = {}
    for source in sorted(HOME.glob("*.c")):
        made[source.name] = folder / f"right-{source.stem}.o"
        subprocess.run(["gcc", *_FLAGS, "-c", str(source), "-o", str(made[source.name])], check=True)
    return made
