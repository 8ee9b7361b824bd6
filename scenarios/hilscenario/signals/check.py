"""Whether a formula can be judged at all: its names, its words, and whether it could ever hold and ever fail.

A misspelt word is no value that a signal can have, so a comparison with it would pass or fail for ever. A formula that
can only have one verdict judges nothing, so it is refused before a run.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import lark

from hilbridge.errors import nearest
from hilscenario.signals.domains import Domain, Domains, Numbers, Truths, Words
from hilscenario.signals.stl import FormulaError, Node, is_signal, parse, unquoted

_TEMPORAL = ("always", "eventually", "historically", "once", "until", "rise", "fall")
_MOST_ATOMS = 10  # beyond that a formula is not searched for having one verdict only


def formula_problem(text: str, domains: Domains) -> str | None:
    """What is wrong with a formula, in one line; None where it can be judged."""
    try:
        check_formula(text, domains)
    except FormulaError as error:
        return str(error)
    return None


def check_formula(text: str, domains: Domains) -> None:
    """Raises FormulaError in one line that names what cannot be, and the nearest that can."""
    tree = parse(text)
    for node in tree.iter_subtrees():
        if node.data == "compare":
            _check_comparison(node, domains)
        elif node.data == "holds":
            _check_truth(node, domains)
    for part in _parts(tree):
        _check_both_verdicts(part, text)


def _domain(name: str, domains: Domains) -> Domain:
    if name not in domains:
        raise FormulaError(f"no signal `{name}`; {nearest(name, domains)}")
    return domains[name]


def _check_truth(node: Node, domains: Domains) -> None:
    name = str(node.children[0])
    domain = _domain(name, domains)
    if isinstance(domain, Words):
        raise FormulaError(f"`{name}` is a word; compare it, as in `{name} == {domain.values[0]}`")
    if isinstance(domain, Numbers):
        raise FormulaError(f"`{name}` is a number; compare it, as in `{name} >= 0`")


def _check_comparison(node: Node, domains: Domains) -> None:
    left, operator, right = node.children
    text = f"{_written(left)} {operator} {_written(right)}"
    if not is_signal(left) and not isinstance(left, lark.Tree) and not is_signal(right, domains):
        raise FormulaError(f"`{text}`: no signal in it; write the signal first, as in `device.state == Assist`")
    if is_signal(left):
        domain = _domain(str(left), domains)
        if isinstance(domain, Words):
            _check_words(text, domain, str(operator), right, domains)
            return
        if isinstance(domain, Truths) and not is_signal(right, domains) and _written(right) not in ("0", "1"):
            raise FormulaError(f"`{text}`: {left} is true or false; write `{left}` or `not {left}`")
    if isinstance(left, lark.Tree):
        _domain(str(left.children[0]), domains)
    for side in (left, right):
        if is_signal(side, domains) and isinstance(domains[str(side)], Words):
            raise FormulaError(
                f"`{text}`: {side} is a word; write it first, as in `{side} == {_example(side, domains)}`"
            )
    if isinstance(right, lark.Token) and right.type != "NUMBER":
        _domain(unquoted(right), domains)
    _check_range(text, left, str(operator), right, domains)


def _example(signal: object, domains: Domains) -> str:
    domain = domains[str(signal)]
    return domain.values[0] if isinstance(domain, Words) else "0"


def _check_words(text: str, domain: Words, operator: str, right: object, domains: Domains) -> None:
    if operator not in ("==", "!="):
        raise FormulaError(f"`{text}`: words can only be compared with == and !=")
    if is_signal(right, domains):
        other = domains[str(right)]
        if not isinstance(other, Words) or not set(other.values) & set(domain.values):
            raise FormulaError(f"`{text}`: {right} never has a value of these: {', '.join(domain.values)}")
        return
    word = unquoted(right)
    if word not in domain.values:
        raise FormulaError(f"`{text}`: no such value; {nearest(word, domain.values)}")


def _check_range(text: str, left: object, operator: str, right: object, domains: Domains) -> None:
    """Refuse `confidence <= 1`: the limits of the signals alone decide it."""
    if isinstance(left, lark.Tree | lark.Token) and left == right:
        raise FormulaError(f"`{text}`: both sides are the same")
    low, high = _limits(left, domains)
    other_low, other_high = _limits(right, domains)
    least, most = low - other_high, high - other_low
    never_fails = {">=": least >= 0, ">": least >= 0, "<=": most <= 0, "<": most <= 0}
    never_holds = {">=": most < 0, ">": most < 0, "<=": least > 0, "<": least > 0, "==": most < 0 or least > 0}
    if never_fails.get(operator, False) or (operator == "!=" and (most < 0 or least > 0)):
        raise FormulaError(f"`{text}` can never fail: {_range(left, low, high)}")
    if never_holds.get(operator, False):
        raise FormulaError(f"`{text}` can never hold: {_range(left, low, high)}")


def _range(side: object, low: float, high: float) -> str:
    return f"{_written(side)} lies within {low:g}..{high:g}"


def _limits(side: object, domains: Domains) -> tuple[float, float]:
    if isinstance(side, lark.Tree):
        low, high = _limits(side.children[0], domains)
        return (0.0 if low <= 0.0 <= high else min(abs(low), abs(high))), max(abs(low), abs(high))
    if isinstance(side, lark.Token) and side.type == "NUMBER":
        return float(side), float(side)
    domain = domains[str(side)]
    if isinstance(domain, Numbers):
        return domain.low, domain.high
    return (0.0, 1.0) if isinstance(domain, Truths) else (-math.inf, math.inf)


def _written(side: object) -> str:
    return f"abs({side.children[0]})" if isinstance(side, lark.Tree) else unquoted(side)


def _parts(tree: Node) -> Iterator[Node]:
    """The formula, and every formula that a temporal operator looks at."""
    yield tree
    for node in tree.iter_subtrees():
        if node.data in _TEMPORAL:
            yield from (child for child in node.children if isinstance(child, lark.Tree) and child.data != "window")


def _check_both_verdicts(part: Node, text: str) -> None:
    """Refuse `act or not act`: whatever its atoms are, one verdict only. Temporal parts count as atoms."""
    atoms = sorted(set(_atoms(part)))
    if len(atoms) > _MOST_ATOMS:
        return
    verdicts = {
        _value(part, dict(zip(atoms, values, strict=True)))
        for values in itertools.product((False, True), repeat=len(atoms))
        if _possible(atoms, values)
    }
    if len(verdicts) == 1:
        raise FormulaError(f"`{text}` can never {'fail' if verdicts.pop() else 'hold'}, whatever happens")


def _atoms(node: Node) -> Iterator[str]:
    if node.data in ("implies", "disjunction", "conjunction", "negation"):
        for child in node.children:
            assert isinstance(child, lark.Tree)
            yield from _atoms(child)
    else:
        yield _key(node)


def _key(node: Node) -> str:
    """Equal for equal parts; `a == WORD` is written out, so that two words of one signal exclude each other."""
    if node.data == "compare" and str(node.children[1]) in ("==", "!=") and is_signal(node.children[0]):
        return f"{node.children[0]}\0{_written(node.children[2])}"
    return str(node)


def _possible(atoms: list[str], values: tuple[bool, ...]) -> bool:
    """No signal has two values at once."""
    held = [atom.split("\0")[0] for atom, value in zip(atoms, values, strict=True) if value and "\0" in atom]
    return len(held) == len(set(held))


def _value(node: Node, atoms: dict[str, bool]) -> bool:
    children = [child for child in node.children if isinstance(child, lark.Tree)]
    match str(node.data):
        case "implies":
            return not _value(children[0], atoms) or _value(children[1], atoms)
        case "disjunction":
            return any(_value(child, atoms) for child in children)
        case "conjunction":
            return all(_value(child, atoms) for child in children)
        case "negation":
            return not _value(children[0], atoms)
        case "compare" if str(node.children[1]) == "!=" and is_signal(node.children[0]):
            return not atoms[_key(node)]
        case _:
            return atoms[_key(node)]
