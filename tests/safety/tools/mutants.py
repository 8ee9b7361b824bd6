"""Small wrongs to do to a source file: each mutant is the same tree with one node changed."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from copy import deepcopy
from functools import partial
from typing import NamedTuple

_COMPARE = {
    ast.Lt: [ast.LtE, ast.Gt],
    ast.LtE: [ast.Lt],
    ast.Gt: [ast.GtE, ast.Lt],
    ast.GtE: [ast.Gt],
    ast.Eq: [ast.NotEq],
    ast.NotEq: [ast.Eq],
    ast.Is: [ast.IsNot],
    ast.IsNot: [ast.Is],
    ast.In: [ast.NotIn],
    ast.NotIn: [ast.In],
}
_BINARY = {
    ast.Add: [ast.Sub],
    ast.Sub: [ast.Add],
    ast.Mult: [ast.FloorDiv],
    ast.FloorDiv: [ast.Mult],
    ast.Div: [ast.Mult],
    ast.Mod: [ast.Mult],
    ast.BitAnd: [ast.BitOr],
    ast.BitOr: [ast.BitAnd],
    ast.BitXor: [ast.BitOr],
    ast.LShift: [ast.RShift],
    ast.RShift: [ast.LShift],
    ast.Pow: [ast.Mult],
}


class Mutant(NamedTuple):
    """`key` names it across unrelated edits: enclosing function, what was there, what is there now, which of such."""

    key: str
    line: int
    build: Callable[[], ast.Module]
    place: str  # function, class or module


def _changes(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """(what, replacement) for every wrong that can be done to this node alone."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        for other in _COMPARE.get(type(node.ops[0]), []):
            yield "compare", ast.Compare(node.left, [other()], node.comparators)
    elif isinstance(node, ast.Compare):
        for k, op in enumerate(node.ops):
            for other in _COMPARE.get(type(op), [])[:1]:
                yield "compare", ast.Compare(node.left, [*node.ops[:k], other(), *node.ops[k + 1 :]], node.comparators)
    elif isinstance(node, ast.BinOp):
        for swapped in _BINARY.get(type(node.op), []):
            yield "operator", ast.BinOp(node.left, swapped(), node.right)
    elif isinstance(node, ast.BoolOp):
        yield "and-or", ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
        for k in range(len(node.values)):
            rest = node.values[:k] + node.values[k + 1 :]
            yield "operand dropped", rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub, ast.Invert)):
        yield "unary dropped", node.operand
    elif isinstance(node, ast.IfExp):
        yield "branches swapped", ast.IfExp(node.test, node.orelse, node.body)
    elif isinstance(node, ast.Dict) and len(node.keys) > 1:  # tables are behaviour: the transitions among them
        for k in range(len(node.keys)):
            dropped = "" if (entry := node.keys[k]) is None else f" {ast.unparse(entry)}"
            yield (
                f"entry dropped{dropped}",
                ast.Dict(node.keys[:k] + node.keys[k + 1 :], node.values[:k] + node.values[k + 1 :]),
            )
    elif isinstance(node, ast.Constant):
        yield from _constants(node)


def _constants(node: ast.Constant) -> Iterator[tuple[str, ast.AST]]:
    value = node.value
    if isinstance(value, bool):
        yield "constant", ast.Constant(not value)
    elif isinstance(value, (int, float)):
        yield "constant", ast.Constant(value + 1)
        if value not in (0, 1):
            yield "constant", ast.Constant(value - 1)
    elif isinstance(value, str):
        yield "constant", ast.Constant(value + "X")
    elif isinstance(value, bytes):
        yield "constant", ast.Constant(value + b"X")


def _statement_changes(node: ast.stmt) -> Iterator[tuple[str, ast.stmt | None]]:
    if isinstance(node, (ast.Assign, ast.AugAssign)) or (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    ):
        yield "statement dropped", ast.Pass()
    if isinstance(node, ast.AugAssign) and type(node.op) in _BINARY:
        yield "operator", ast.AugAssign(node.target, _BINARY[type(node.op)][0](), node.value)
    if isinstance(node, ast.If):
        for test in (True, False):
            yield f"condition {test}", ast.If(ast.Constant(test), node.body, node.orelse)
    if isinstance(node, ast.Return) and node.value is not None and not isinstance(node.value, ast.Constant):
        yield "returns None", ast.Return(ast.Constant(None))


_HELP = ("help", "description", "epilog", "metavar")


def _mutable(node: ast.AST, path: tuple[tuple[ast.AST, str, int | None], ...]) -> bool:
    """Types, imports, docstrings and the wording of errors and of help are no behaviour; defaults of records are."""
    for parent, field, _ in path:
        if isinstance(parent, (ast.Raise, ast.ImportFrom, ast.Import, ast.JoinedStr)):
            return False
        if field in ("annotation", "returns", "decorator_list", "bases"):
            return False
        if isinstance(parent, ast.keyword) and parent.arg in _HELP:
            return False
        if isinstance(parent, ast.If) and isinstance(parent.test, ast.Name) and parent.test.id == "TYPE_CHECKING":
            return False
        if isinstance(parent, ast.If) and "__main__" in ast.dump(parent.test):
            return False
    if isinstance(node, ast.If) and "__main__" in ast.dump(node.test):
        return False
    docstring = isinstance(node, ast.Constant) and isinstance(node.value, str)
    if docstring and path and isinstance(path[-1][0], ast.Expr):
        return False
    return not isinstance(node, (ast.Raise, ast.ImportFrom, ast.Import, ast.JoinedStr))


def _walk(node: ast.AST, path: tuple[tuple[ast.AST, str, int | None], ...] = ()) -> Iterator[tuple[ast.AST, tuple]]:
    yield node, path
    for field, value in ast.iter_fields(node):
        if isinstance(value, ast.AST):
            yield from _walk(value, (*path, (node, field, None)))
        elif isinstance(value, list):
            for k, entry in enumerate(value):
                if isinstance(entry, ast.AST):
                    yield from _walk(entry, (*path, (node, field, k)))


def _replaced(tree: ast.Module, path: tuple, new: ast.AST) -> ast.Module:
    """A deep copy of the tree with the node at the end of `path` exchanged."""
    twin, new = deepcopy(tree), deepcopy(new)
    here: ast.AST = twin
    for _, field, k in path[:-1]:
        value = getattr(here, field)
        here = value if k is None else value[k]
    _, field, k = path[-1]
    if k is None:
        setattr(here, field, new)
    else:
        getattr(here, field)[k] = new
    return ast.fix_missing_locations(twin)


def _place(path: tuple) -> str:
    names = [p.name for p, _, _ in path if isinstance(p, (ast.FunctionDef, ast.ClassDef))]
    return ".".join(names) or "module"


def mutants(source: str) -> Iterator[Mutant]:
    """All mutants of a source file, each with a stable key."""
    tree = ast.parse(source)
    seen: dict[str, int] = {}
    for node, path in _walk(tree):
        if not path or not _mutable(node, path):
            continue
        changes: list[tuple[str, ast.AST]] = list(_changes(node))
        if isinstance(node, ast.stmt):
            changes += [(what, new) for what, new in _statement_changes(node) if new is not None]
        for what, new in changes:
            old = ast.unparse(node).splitlines()[0]
            now = ast.unparse(new).splitlines()[0] if what != "statement dropped" else "pass"
            key = f"{_place(path)}: {what}" + ("" if isinstance(node, ast.Dict) else f": {old} -> {now}")
            seen[key] = seen.get(key, 0) + 1
            if seen[key] > 1:
                key += f" [{seen[key]}]"
            parents = [p for p, field, _ in path if field == "body"]
            inside = "function" if any(isinstance(p, ast.FunctionDef) for p in parents) else "module"
            if inside == "module" and any(isinstance(p, ast.ClassDef) for p in parents):
                inside = "class"
            yield Mutant(key, getattr(node, "lineno", 0), partial(_replaced, tree, path, new), inside)
