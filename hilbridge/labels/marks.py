"""Marks of a running session: a person presses a key, or a marker stream speaks, when the wearer begins another verb."""

from __future__ import annotations

from collections.abc import Mapping

from hilbridge.errors import InputError
from hilbridge.labels.table import verb_named
from hilbridge.rows import LabelRow

_ENDS = frozenset({"", "stop", "end"})


class Marks:
    """Turns marks into labels. A verb lasts until the next mark; the same verb again, `stop` or `end` ends it."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._verb: str | None = None
        self._since_ns = 0

    @property
    def verb(self) -> str | None:
        """What is marked now."""
        return self._verb

    def mark(self, text: str, now_ns: int) -> LabelRow | None:
        """The label that this mark ends, if one does. Raises InputError for a word that is no verb."""
        word = text.strip()
        verb = None if word.casefold() in _ENDS else verb_named(word, f"mark of {self._source}")
        ended = self.finish(now_ns)
        if ended is None or verb != ended.verb:
            self._verb, self._since_ns = verb, now_ns
        return ended

    def finish(self, now_ns: int) -> LabelRow | None:
        """End what lasts, as the run does at its end."""
        verb, self._verb = self._verb, None
        if verb is None or now_ns <= self._since_ns:
            return None
        return LabelRow(self._since_ns, now_ns, verb, self._source)


def keys_of(texts: list[str]) -> Mapping[str, str]:
    """Keys and their verbs out of texts such as `p=Pour`. Raises InputError."""
    keys: dict[str, str] = {}
    for text in texts:
        key, equals, verb = text.partition("=")
        if len(key) != 1 or not equals or not key.isprintable():
            raise InputError(f"--mark {text}: write one key and a verb, such as p=Pour")
        if key in keys:
            raise InputError(f"--mark {text}: {key} is {keys[key]} already; take another key")
        keys[key] = verb_named(verb, f"--mark {text}")
    return keys
