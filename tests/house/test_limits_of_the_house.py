"""The limits of this house: how long a function and a file may be, how many parameters, how many modules a folder."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("hilbridge", "firmware_sim", "scenarios", "tests")
FILES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]

FUNCTION_LINES = 60
FILE_LINES = 350
FOLDER_MODULES = 12
PARAMETERS = 7

# Options that a library hands over one by one, by name.
BY_NAME = {"hilbridge/bus/simulated/interface.py: __init__"}  # python-can's own constructor
Function = ast.FunctionDef | ast.AsyncFunctionDef


def _functions(path: Path) -> Iterator[tuple[Function, bool]]:
    """Every function of a file, and whether it is a method."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    methods = {id(node) for kind in ast.walk(tree) if isinstance(kind, ast.ClassDef) for node in kind.body}
    for node in ast.walk(tree):
        if isinstance(node, Function):
            yield node, id(node) in methods


def _parameters(function: Function, is_method: bool) -> int:
    arguments = function.args
    count = len(arguments.posonlyargs) + len(arguments.args) + len(arguments.kwonlyargs)
    count += (arguments.vararg is not None) + (arguments.kwarg is not None)
    bound = is_method and not any(ast.unparse(marker) == "staticmethod" for marker in function.decorator_list)
    return count - bound


def _is_command(path: Path, function: Function) -> bool:
    """A command of the command line: its parameters are the options, which typer reads from its signature."""
    registered = f".command()({function.name})" in path.read_text(encoding="utf-8")
    return registered or any(".command(" in ast.unparse(marker) for marker in function.decorator_list)


def _name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_no_function_is_longer_than_a_screen() -> None:
    long = [
        f"{_name(path)}: {node.name} has {node.end_lineno - node.lineno + 1} lines"
        for path in FILES
        for node, _ in _functions(path)
        if node.end_lineno is not None and node.end_lineno - node.lineno + 1 > FUNCTION_LINES
    ]
    assert long == []


def test_no_function_has_more_parameters_than_one_remembers() -> None:
    many = [
        f"{_name(path)}: {node.name} has {_parameters(node, is_method)} parameters"
        for path in FILES
        for node, is_method in _functions(path)
        if not _is_command(path, node)
        and _parameters(node, is_method) > PARAMETERS
        and f"{_name(path)}: {node.name}" not in BY_NAME
    ]
    assert many == []


def test_no_file_is_longer_than_one_reads_at_a_time() -> None:
    lines = {_name(path): len(path.read_text(encoding="utf-8").splitlines()) for path in FILES}
    assert {name: count for name, count in lines.items() if count > FILE_LINES} == {}


@pytest.mark.parametrize("top", FOLDERS)
def test_no_folder_has_more_modules_than_one_overlooks(top: str) -> None:
    folders = [ROOT / top, *(path for path in (ROOT / top).rglob("*") if path.is_dir())]
    crowded = {}
    for folder in folders:
        modules = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
        # The packages' own roots, and the tests that mirror one of them.
        is_root = folder in (ROOT / "hilbridge", ROOT / "firmware_sim", ROOT / "tests" / "firmware_sim")
        if len(modules) > FOLDER_MODULES and not is_root:
            crowded[_name(folder)] = len(modules)
    assert crowded == {}
