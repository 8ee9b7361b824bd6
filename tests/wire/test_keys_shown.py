"""No text that a program makes of an object shows a key: every class that holds one is found in the sources and looked at."""

from __future__ import annotations

import ast
import importlib.util
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from firmware_sim.memory import ControllerState
from firmware_sim.node import Node
from hilbridge.config import Config
from hilbridge.conformance.tester import ByHand
from hilbridge.core.session import Purpose, Session
from hilbridge.wire.dbc import default_dbc_path
from hilbridge.wire.secoc import Authenticator

ROOT = Path(__file__).parents[2]
KEY = bytes(range(0x41, 0x51))
_NAME = re.compile(r"key$")
_NO_SECRETS = {"int", "str"}  # of sorting, of tables


def holders() -> set[str]:
    """Classes with a field or an attribute that is called a key and may hold bytes."""
    found = set()
    for folder in ("hilbridge", "firmware_sim", "scenarios", "examples"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for kind in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(kind, ast.ClassDef) and any(map(_holds, ast.walk(kind))):
                    found.add(kind.name)
    return found


def _holds(node: ast.AST) -> bool:
    if isinstance(node, ast.AnnAssign):
        return _is_key(node.target) and ast.unparse(node.annotation) not in _NO_SECRETS
    if isinstance(node, ast.Assign):
        targets = [part for target in node.targets for part in getattr(target, "elts", [target])]
        return any(isinstance(target, ast.Attribute) and _is_key(target) for target in targets)
    return False


def _is_key(target: ast.expr) -> bool:
    name = target.attr if isinstance(target, ast.Attribute) else target.id if isinstance(target, ast.Name) else ""
    return _NAME.search(name) is not None


def _session() -> Session:
    session = Session(Authenticator(KEY))
    session.request(Purpose.ARM, 1, 0)
    session._key = KEY
    return session


def _node() -> Node:
    node = object.__new__(Node)
    node._key = KEY
    node.device = ControllerState(KEY, 1)  # type: ignore[assignment]
    return node


def _second_device() -> Any:
    spec = importlib.util.spec_from_file_location("example_of_a_device", ROOT / "examples" / "second_device.py")
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    device = example.Device(str(default_dbc_path()), KEY)
    device.session_key = KEY
    return device


def _tester() -> ByHand:
    tester = object.__new__(ByHand)
    tester.session, tester.key, tester.freshness = 1, KEY, 0
    return tester


MADE: dict[str, Callable[[], Any]] = {
    "Authenticator": lambda: Authenticator(KEY),
    "ByHand": _tester,
    "ControllerState": lambda: ControllerState(KEY, 1, key=KEY),
    "Device": _second_device,
    "Node": _node,
    "Session": _session,
}


def test_every_class_that_holds_a_key_is_looked_at() -> None:
    assert holders() == set(MADE)


@pytest.mark.parametrize("name", MADE)
def test_no_text_of_it_shows_the_key(name: str) -> None:
    made = MADE[name]()
    for text in (repr(made), str(made), f"{made}", repr([made]), repr({"it": made})):
        assert KEY.decode() not in text
        assert KEY.hex() not in text.lower()
        assert str(list(KEY))[1:-1] not in text


def test_the_configuration_knows_the_file_of_a_key_not_the_key(tmp_path: Path) -> None:
    file = tmp_path / "arm.key"
    file.write_text(KEY.hex())
    file.chmod(0o600)
    config = Config.model_validate({"bus": {"key_file": str(file)}})
    assert KEY.hex() not in repr(config) + config.model_dump_json()
