"""Small wrongs to do to the C controller, a token or a statement at a time. Pure.

C of this house is plain: a statement a line, no macros that hide an operator. So a list of tokens finds what a syntax tree
would, and a mutant that does not compile is told by the compiler and counted apart.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

_SWAPPED: dict[str, tuple[str, ...]] = {
    "<": ("<=", ">"),
    "<=": ("<",),
    ">": (">=", "<"),
    ">=": (">",),
    "==": ("!=",),
    "!=": ("==",),
    "&&": ("||",),
    "||": ("&&",),
    "+": ("-",),
    "-": ("+",),
    "*": ("+",),
    "/": ("*",),
    "%": ("*",),
    "&": ("|",),
    "|": ("&",),
    "^": ("|",),
    "<<": (">>",),
    ">>": ("<<",),
    "+=": ("-=",),
    "-=": ("+=",),
    "true": ("false",),
    "false": ("true",),
}
_TOKEN = re.compile(
    r"/\*.*?\*/|\"(?:\\.|[^\"])*\"|'(?:\\.|[^'])*'|0[xX][0-9a-fA-F]+U?|\d+U?|[A-Za-z_]\w*"
    r"|<<=|>>=|->|\+\+|--|<<|>>|<=|>=|==|!=|&&|\|\||[-+*/%&|^]=|.",
    re.DOTALL,
)
_BINARY = frozenset("+-*/%&|^") | {"<<", ">>"}
_AFTER_A_VALUE = re.compile(r"[\w)\]]$")
_STATEMENT = re.compile(
    r"^ +(?! )(?!return |break|continue|static|const|case|default|u?int|bool|uint|size_t|ctl_\w+ )[^{}/#]+;$"
)


class CMutant(NamedTuple):
    """`key` names it across unrelated edits: function, what was there, what is there now, which of such in it."""

    key: str
    line: int
    source: str


def mutants(source: str) -> Iterator[CMutant]:
    """All of them, in the order of the text."""
    seen: dict[str, int] = {}
    for start, end, new, what in (*_tokens(source), *_statements(source)):
        line = source.count("\n", 0, start) + 1
        key = f"{_function(source, start)}: {what}"
        seen[key] = seen.get(key, 0) + 1
        yield CMutant(f"{key} #{seen[key]}", line, source[:start] + new + source[end:])


def _tokens(source: str) -> Iterator[tuple[int, int, str, str]]:
    body = False
    previous = ""
    for found in _TOKEN.finditer(source):
        token = found[0]
        if token.isspace() or token.startswith("/*"):
            continue
        at_line = source.rfind("\n", 0, found.start()) + 1
        text = source[at_line : source.find("\n", at_line)]
        body = (body and not text.startswith("}")) or (token == "{" and text.endswith(") {"))
        is_code = body and not text.startswith(("#", "static const", "    static const"))
        if is_code:
            yield from _changes(found, token, previous)
        previous = token


def _changes(found: re.Match[str], token: str, previous: str) -> Iterator[tuple[int, int, str, str]]:
    start, end = found.span()
    if token in _SWAPPED:
        value_before = bool(_AFTER_A_VALUE.search(previous)) and previous not in ("return", "else")
        if token in _BINARY and not value_before:
            return
        for other in _SWAPPED[token]:
            yield start, end, other, f"{token} -> {other}"
    elif token == "!":
        yield start, end, "", "! dropped"
    elif re.fullmatch(r"\d+U?", token):
        number, suffix = int(token.rstrip("U")), "U" if token.endswith("U") else ""
        yield start, end, f"{number + 1}{suffix}", f"{token} -> {number + 1}"


def _statements(source: str) -> Iterator[tuple[int, int, str, str]]:
    start = 0
    for line in source.splitlines(keepends=True):
        text = line.rstrip("\n")
        if _STATEMENT.match(text) and text.count("(") == text.count(")"):
            yield start, start + len(text), "    ;", f"dropped {text.strip()}"
        start += len(line)


def _function(source: str, at: int) -> str:
    heads = re.findall(r"^(?:static )?[\w ]+\*?\b(\w+)\([^;]*?\) \{", source[:at], re.MULTILINE | re.DOTALL)
    return str(heads[-1]) if heads else "file"
