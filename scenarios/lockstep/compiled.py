"""The simulated device compiled with mypyc: the same bytes in less time, for campaigns and long scenarios.

The compiled modules lie in a folder of their own and count only where that stands before the sources on the path, so that
tests and proofs never take them for the sources by mistake.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
from pathlib import Path

from firmware_sim import controller
from hilbridge.errors import InputError
from hilbridge.files import write_whole
from hilbridge.lease import run_leased

_MARK = "made-by-hilscenario-compile"  # only a folder that has it may be emptied
# Those at the edge: the process, its files and its bus are not what a scenario runs.
_NOT_COMPILED = ("__init__.py", "attachment.py", "diagram.py", "keys.py", "node.py", "priority.py")


def is_compiled() -> bool:
    """Whether the device that this process has imported is compiled."""
    return not controller.__file__.endswith(".py")


def compile_device(out: Path) -> Path:
    """Compile a copy of `firmware_sim` into the folder `out`, which is made anew. Raises InputError."""
    if is_compiled():
        raise InputError(f"{controller.__file__} is compiled already; take its folder off PYTHONPATH first")
    if importlib.util.find_spec("mypyc") is None or importlib.util.find_spec("setuptools") is None:
        raise InputError("compiling needs mypyc; pip install 'hilbridge[compile]'")
    if not any(shutil.which(name) for name in (os.environ.get("CC", "cc"), "gcc", "clang")):
        raise InputError("compiling needs a C compiler; install gcc, or name one in CC")
    package = Path(controller.__file__).parent
    if out.exists() and not (out / _MARK).is_file():
        raise InputError(f"{out}: is there and not made by this command; name another folder with --out")
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    (out / _MARK).touch()
    shutil.copytree(package, out / package.name, ignore=shutil.ignore_patterns("__pycache__"))
    modules = [str(path.relative_to(out)) for path in sorted(out.rglob("*.py")) if path.name not in _NOT_COMPILED]
    command = [sys.executable, "-m", "mypyc", "--config-file=", *modules]
    # The third level of optimisation takes twice as long to compile for nothing that can be measured.
    environment = {"MYPYC_OPT_LEVEL": "2", **os.environ}
    done = run_leased(command, cwd=out, env=environment)
    if done.returncode:
        write_whole(out / "mypyc.log", done.stdout + done.stderr)
        raise InputError(f"{out / 'mypyc.log'}: mypyc ended with {done.returncode}; it says why")
    shutil.rmtree(out / "build")
    return out
