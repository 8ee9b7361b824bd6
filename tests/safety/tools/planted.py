"""Small defects at the edges: each is planted alone in a copy of the tree, and the test named for it has to fail.

They stand in edge_defects.toml: where (`file`), what it is (`what`), the text there (`old`, once in its file), what is there
instead (`new`), and who finds it (`test`). Copies keep no compiled files, so that none of another defect is used.
"""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

from tests.safety.table import REFERENCE, Row, Scale

ROOT = Path(__file__).parents[3]
TABLE = ROOT / "tests" / "safety" / "edge_defects.toml"
JOBS = os.cpu_count() or 1
QUICK = 3
TIMEOUT_S = 120.0
_NEEDED = ("dbc", "firmware_sim", "hilbridge", "scenarios", "tests", "pyproject.toml")
_FAILED = 1  # pytest's exit code where tests ran and failed; any other one shows nothing


class Planted(NamedTuple):
    """One defect and the test that finds it."""

    file: str
    what: str
    old: str
    new: str
    test: str


def table() -> list[Planted]:
    """All of them."""
    return [Planted(**entry) for entry in tomllib.loads(TABLE.read_text(encoding="utf-8"))["defect"]]


@contextmanager
def copies(count: int) -> Iterator[SimpleQueue[Path]]:
    """So many trees to plant in."""
    with tempfile.TemporaryDirectory() as folder:
        trees: SimpleQueue[Path] = SimpleQueue()
        for number in range(count):
            tree = Path(folder, str(number))
            tree.mkdir()
            for name in _NEEDED:
                if (ROOT / name).is_dir():
                    ignored = shutil.ignore_patterns("__pycache__", ".*_cache")
                    shutil.copytree(ROOT / name, tree / name, symlinks=True, ignore=ignored)
                else:
                    shutil.copy(ROOT / name, tree / name)
            trees.put(tree)
        yield trees


def run_tests(tree: Path, tests: list[str]) -> int | None:
    """pytest's exit code in that tree; None where it had to be ended."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
    environment = os.environ | REFERENCE | {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            [*command, "--hypothesis-seed=0", *tests],
            cwd=tree,
            env=environment,
            capture_output=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return None
    return done.returncode


def is_found(planted: Planted, trees: SimpleQueue[Path]) -> bool:
    """Plant it in a tree that is free, ask its test, and take it out again."""
    tree = trees.get()
    path = tree / planted.file
    source = path.read_text(encoding="utf-8")
    try:
        path.write_text(source.replace(planted.old, planted.new), encoding="utf-8")
        return run_tests(tree, [planted.test]) == _FAILED
    finally:
        path.write_text(source, encoding="utf-8")
        trees.put(tree)


def run(scale: Scale) -> list[Row]:
    """All of them; the quick run a seeded few. Without any of them the same tests pass."""
    chosen = table()
    if scale.quick:
        chosen = random.Random(scale.seed).sample(chosen, QUICK)
    with copies(min(JOBS, len(chosen))) as trees, ThreadPoolExecutor(JOBS) as pool:
        tree = trees.get()
        clean = run_tests(tree, sorted({planted.test for planted in chosen})) == 0
        trees.put(tree)
        found = list(pool.map(lambda planted: is_found(planted, trees), chosen))
    for planted, seen in zip(chosen, found, strict=True):
        if not seen:
            print(f"not found: {planted.file}: {planted.what} ({planted.test})", file=sys.stderr)
    figure = f"{sum(found)} of {len(found)} found, {'no' if clean else 'an'} alarm without one"
    what = f"{QUICK} of the small defects" if scale.quick else "small defects"
    return [
        Row("defects", f"{what} at edges, planted one by one: found by the test named", figure, clean and all(found))
    ]
