"""Signal temporal logic over named signals, with quantitative robustness: how near a run came to failing.

Semantics are those of Donze and Maler (2010) for discrete time on a finite trace: `always` and `eventually` look at the
part of their window that the trace has; robustness of `x >= c` is x - c; of a word or truth value it is +/-1. The text:

    always (gate.act -> device.armed)
    always (rise(fault.gaze) -> eventually[0, 150 ms] device.assist_nm == 0)
    device.state == Follow until[0, 5 s] device.state == Ready
    always gate.verb != "Turn on"

A word that is not one plain name stands in double quotes. A length of time has its unit, 0 may go without.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Container
from dataclasses import dataclass

import lark
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from hilscenario.signals.trace import Trace

_GRAMMAR = r"""
?start: implication
?implication: disjunction
            | disjunction "->" implication -> implies
?disjunction: conjunction ("or" conjunction)*
?conjunction: until ("and" until)*
?until: unary
      | unary "until" window unary -> until
?unary: "not" unary -> negation
      | "always" window unary -> always
      | "eventually" window unary -> eventually
      | "historically" window unary -> historically
      | "once" window unary -> once
      | "rise" "(" implication ")" -> rise
      | "fall" "(" implication ")" -> fall
      | "(" implication ")"
      | comparison
?comparison: value OPERATOR value -> compare
          | NAME -> holds
?value: NAME | NUMBER | STRING | "abs" "(" NAME ")" -> absolute
window: ["[" time "," time "]"]
time: NUMBER [UNIT]
UNIT: "ms" | "s"
OPERATOR: ">=" | "<=" | "==" | "!=" | ">" | "<"
STRING: /"[^"]*"/
NAME: /[A-Za-z_][A-Za-z0-9_.\/]*/
NUMBER: /[-+]?\d+(\.\d+)?([eE][-+]?\d+)?/
%ignore /\s+/
"""

Robustness = NDArray[np.float64]
Node = lark.Tree[lark.Token]
_LONGEST_TEXT, _DEEPEST = 2_000, 40
_LONGEST_MS = 1e9


class FormulaError(ValueError):
    """A formula that cannot be read; the text shows where."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """`robustness` > 0 holds, < 0 is violated; `at_ms` is where an outermost `always` came nearest to failing.

    idle_premises: how many implications have a premise that held at no time, so that they were never put to the test.
    """

    robustness: float
    at_ms: float
    idle_premises: int = 0

    @property
    def holds(self) -> bool:
        return self.robustness >= 0.0


@functools.cache
def _parser() -> lark.Lark:
    return lark.Lark(_GRAMMAR, parser="lalr", maybe_placeholders=True)


@functools.lru_cache(maxsize=1024)
def parse(text: str) -> lark.Tree[lark.Token]:
    """Read a formula. Raises FormulaError that says where it could not be read."""
    if len(text) > _LONGEST_TEXT:
        raise FormulaError(f"a formula of {len(text)} characters; at most {_LONGEST_TEXT} are read")
    try:
        tree = _parser().parse(text)
    except lark.exceptions.UnexpectedInput as error:
        token = getattr(error, "token", None)
        at_end = token is not None and token.type == "$END"
        where = "its end" if at_end else f"column {getattr(error, 'column', '?')}"
        raise FormulaError(
            f"cannot read `{text}` at {where}; `hilbridge docs scenarios` says what a formula may say"
        ) from None
    if _depth(tree) > _DEEPEST:
        raise FormulaError(f"a formula nested {_depth(tree)} deep; at most {_DEEPEST} are read")
    for window in tree.find_data("window"):
        _milliseconds(window)
    return tree


def _depth(tree: Node) -> int:
    depth, level = 0, [tree]
    while level:
        depth += 1
        level = [child for node in level for child in node.children if isinstance(child, lark.Tree)]
    return depth


def is_signal(side: object, known: Container[str] | None = None) -> bool:
    """Whether this side of a comparison is a name; with `known`, the name of one of these signals."""
    is_name = isinstance(side, lark.Token) and side.type == "NAME"
    return is_name and (known is None or str(side) in known)


def unquoted(side: object) -> str:
    """A word as it was meant: without its quotes."""
    return str(side).strip('"')


def signal_names(text: str) -> set[str]:
    """Every signal in a formula: names that stand alone or on the left of a comparison, and names with a dot."""
    names = set()
    for tree in parse(text).iter_subtrees():
        if tree.data in ("compare", "holds", "absolute"):
            for place, side in enumerate(tree.children):
                if is_signal(side) and (place == 0 or "." in str(side)):
                    names.add(str(side))
    return names


def judge(text: str, trace: Trace) -> Verdict:
    """Robustness of a formula at the start of a trace.

    Raises FormulaError, or signals.UnknownSignal for a name that the trace does not have.
    """
    tree = parse(text)
    idle = sum(not (_evaluate(node.children[0], trace) >= 0.0).any() for node in tree.find_data("implies"))
    if tree.data == "always":
        inside = _evaluate(tree.children[1], trace)
        low, high = _window(tree.children[0], trace)
        part = inside[low : None if high is None else high + 1]
        if not len(part):
            return Verdict(math.inf, 0.0, idle)
        worst = int(np.argmin(part))
        return Verdict(float(part[worst]), (low + worst) * trace.step_ms, idle)
    return Verdict(float(_evaluate(tree, trace)[0]), 0.0, idle)


def first_ms(text: str, trace: Trace) -> float | None:
    """When a formula first holds; None where it never does."""
    holds = np.flatnonzero(_evaluate(parse(text), trace) >= 0.0)
    return float(holds[0]) * trace.step_ms if len(holds) else None


def holds_now(text: str, values: dict[str, float | str | bool]) -> bool:
    """Whether a formula without temporal operators holds on one sample of values."""
    columns: dict[str, NDArray[np.float64] | NDArray[np.object_]] = {
        name: np.array([value], dtype=object if isinstance(value, str) else np.float64)
        for name, value in values.items()
    }
    return bool(_evaluate(parse(text), Trace(1.0, 1, columns))[0] >= 0.0)


def _evaluate(node: lark.Tree[lark.Token] | lark.Token, trace: Trace) -> Robustness:
    assert isinstance(node, lark.Tree)
    children = node.children
    match str(node.data):
        case "implies":
            return np.maximum(-_evaluate(children[0], trace), _evaluate(children[1], trace))
        case "disjunction":
            return functools.reduce(np.maximum, [_evaluate(child, trace) for child in children])
        case "conjunction":
            return functools.reduce(np.minimum, [_evaluate(child, trace) for child in children])
        case "negation":
            return -_evaluate(children[0], trace)
        case "always" | "eventually" | "historically" | "once" as name:
            inside = _evaluate(children[1], trace)
            return _over_window(inside, _window(children[0], trace), name)
        case "until":
            return _until(children, trace)
        case "rise" | "fall" as edge:
            level = _evaluate(children[0], trace) * (1.0 if edge == "rise" else -1.0)
            before = np.concatenate(([-np.inf], level[:-1]))
            # Only a real change is an edge: at the first sample there is no sample before.
            before[0] = np.inf
            return np.minimum(level, -before)
        case "holds":
            return _truth(trace, str(children[0]))
        case _:
            return _compare(children, trace)


def _compare(children: list[lark.Tree[lark.Token] | lark.Token], trace: Trace) -> Robustness:
    left, operator, right = children
    words = _words(left, right, trace)
    if words is not None:
        equal = np.where(words, 1.0, -1.0)
        if str(operator) not in ("==", "!="):
            raise FormulaError(f"`{left} {operator} {right}`: words can only be compared with == and !=")
        return equal if str(operator) == "==" else -equal
    first, second = _number(left, trace), _number(right, trace)
    match str(operator):
        case ">=" | ">":
            return first - second
        case "<=" | "<":
            return second - first
        case "==":
            return -np.abs(first - second)
        case _:
            return np.abs(first - second) - np.finfo(float).tiny


def _words(left: object, right: object, trace: Trace) -> NDArray[np.bool_] | None:
    if isinstance(left, lark.Token) and left.type == "NAME":
        values = trace[str(left)]
        if values.dtype == object:
            other = trace[str(right)] if is_signal(right, trace.values) else unquoted(right)
            return np.asarray(values == other, dtype=np.bool_)
    return None


def _number(node: lark.Tree[lark.Token] | lark.Token, trace: Trace) -> Robustness:
    if isinstance(node, lark.Tree):
        return np.abs(_number(node.children[0], trace))
    if node.type == "NUMBER":
        return np.full(trace.length, float(node))
    values = trace[str(node)]
    if values.dtype == object:
        raise FormulaError(f"`{node}` is a word, not a number")
    return np.asarray(values, dtype=np.float64)


def _truth(trace: Trace, name: str) -> Robustness:
    values = trace[name]
    if values.dtype == object:
        raise FormulaError(f"`{name}` is a word; compare it, as in `{name} == {values[0]}`")
    return np.where(np.asarray(values, dtype=np.float64) != 0.0, 1.0, -1.0)


def _window(node: lark.Tree[lark.Token] | lark.Token, trace: Trace) -> tuple[int, int | None]:
    assert isinstance(node, lark.Tree)
    if node.children[0] is None:
        return 0, None
    low, high = _milliseconds(node)
    return round(low / trace.step_ms), round(high / trace.step_ms)


def _milliseconds(window: Node) -> tuple[float, float]:
    """Begin and end of a window; (0, inf) of one that is not written."""
    if window.children[0] is None:
        return 0.0, math.inf
    low, high = map(_time_ms, window.children)
    if not 0.0 <= low <= high <= _LONGEST_MS:
        raise FormulaError(f"window [{low:g} ms, {high:g} ms]: has to begin at 0 or later and end after it begins")
    return low, high


def _time_ms(node: Node | lark.Token) -> float:
    assert isinstance(node, lark.Tree)
    number, unit = node.children
    value = float(str(number))
    if unit is None:
        if value != 0.0:
            raise FormulaError(f"`{number}` has no unit; write `{number} ms` or `{number} s`")
        return 0.0
    return value * (1.0 if str(unit) == "ms" else 1000.0)


def _over_window(inside: Robustness, window: tuple[int, int | None], name: str) -> Robustness:
    """Minimum or maximum over [i + low, i + high] (or the same reach into the past), clipped to the trace."""
    smallest = name in ("always", "historically")
    if name in ("historically", "once"):
        return _over_window(inside[::-1], window, "always" if smallest else "eventually")[::-1]
    low, high = window
    length = len(inside)
    empty = np.inf if smallest else -np.inf
    shifted = np.concatenate((inside[low:], np.full(min(low, length), empty)))
    if high is None or high - low >= length:
        accumulate = np.minimum if smallest else np.maximum
        result: Robustness = accumulate.accumulate(shifted[::-1])[::-1]
        return result
    span = high - low + 1
    extremum = minimum_filter1d if smallest else maximum_filter1d
    filtered: Robustness = extremum(shifted, span, mode="constant", cval=empty, origin=-(span // 2))
    return filtered


def _until(children: list[lark.Tree[lark.Token] | lark.Token], trace: Trace) -> Robustness:
    """rho(i) = max over j in the window of min(second[j], min of first over [i, j))."""
    first, second = _evaluate(children[0], trace), _evaluate(children[2], trace)
    low, high = _window(children[1], trace)
    length = len(first)
    if high is None and low == 0:
        result = np.empty(length)
        carried = -np.inf
        for index in range(length - 1, -1, -1):
            carried = max(second[index], min(first[index], carried))
            result[index] = carried
        return result
    result = np.full(length, -np.inf)
    last = length - 1 if high is None else high
    for start in range(length):
        held = first[start : start + low].min() if low else np.inf
        for end in range(start + low, min(start + last, length - 1) + 1):
            result[start] = max(result[start], min(second[end], held))
            held = min(held, first[end])
            if held <= result[start]:
                break
    return result
