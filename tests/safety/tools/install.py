"""Makes a mutant what every test in this process sees."""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import sys
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

from tests.safety.tools.mutants import Mutant

ROOT = Path(__file__).parents[3]


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
        spec = importlib.machinery.ModuleSpec(name, _Loader(self.code), origin=str(self.path))
        spec.has_location = True  # a module that looks for a file beside itself needs its `__file__`
        return spec


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


def _take_over(old: dict[str, Any], new: dict[str, Any], module: str) -> None:
    for name, made in new.items():
        there = old.get(name)
        made, there = getattr(made, "fget", made), getattr(there, "fget", there)
        if isinstance(made, FunctionType) and isinstance(there, FunctionType) and made.__module__ == module:
            if made.__code__.co_freevars == there.__code__.co_freevars:
                there.__code__ = made.__code__
        elif isinstance(made, type) and isinstance(there, type) and made.__module__ == module:
            _take_over(dict(vars(there)), dict(vars(made)), module)


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


_KEPT = (
    "tests",
    "tests.safety",
    "tests.safety.mutation",
    "tests.safety.tools",
    "tests.safety.tools.install",
    "tests.safety.tools.mutants",
    "tests.safety.table",
)
