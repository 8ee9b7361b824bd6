"""Verb vocabularies: what a predictor tells apart, and which of it may be assisted.

The default is the paper's K = 21 classes, 20 frequent EGTEA Gaze+ verbs and a residual `other`, by frequency in the 15,484
annotations, `other` last. A bundle keeps its own vocabulary. A class index is an index into its names; the code that crosses
the bus is the one the DBC's value table gives to the same name.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace

VERBS: tuple[str, ...] = (
    "Take",
    "Put",
    "Open",
    "Cut",
    "Move Around",
    "Inspect/Read",
    "Close",
    "Wash",
    "Transfer",
    "Pour",
    "Clean/Wipe",
    "Divide/Pull Apart",
    "Turn on",
    "Operate",
    "Mix",
    "Squeeze",
    "Spread",
    "Turn off",
    "Compress",
    "Dry",
    "other",
)
OTHER = VERBS.index("other")

# Verbs the device never assists (docs/protocol.md: Move Around, other, unknown are HOLD).
NEVER_ASSISTED = frozenset({VERBS.index("Move Around"), OTHER})
NONE = "none"  # a label's word for nothing at all
MOST_VERBS = 64
_MOST_CHARACTERS = 40
_NEVER = {VERBS[index].casefold() for index in NEVER_ASSISTED}
_SPELT = {verb.casefold(): verb for verb in VERBS}


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """names: of the classes, in order. never_assisted: indices of those that no ACT may name.

    `Move Around` and `other` are always among the latter. Raises ValueError naming what is wrong.
    """

    names: tuple[str, ...] = VERBS
    never_assisted: frozenset[int] = NEVER_ASSISTED

    def __post_init__(self) -> None:
        if not 2 <= len(self.names) <= MOST_VERBS:
            raise ValueError(f"{len(self.names)} verbs: a vocabulary has 2 to {MOST_VERBS}")
        for name in self.names:
            plain = name == " ".join(name.split()) and name.isprintable()
            if not plain or not 0 < len(name) <= _MOST_CHARACTERS or name.casefold() == NONE:
                raise ValueError(
                    f"{name[:60]!r} is no name of a verb (1 to {_MOST_CHARACTERS} characters, not `{NONE}`)"
                )
        folded = [name.casefold() for name in self.names]
        twice = next((name for name, own in zip(self.names, folded, strict=True) if folded.count(own) > 1), None)
        if twice is not None:
            raise ValueError(f"verb {twice!r} is there twice")
        if not self.never_assisted <= set(range(len(self.names))):
            raise ValueError(f"never_assisted {sorted(self.never_assisted)}: not all are verbs of the vocabulary")
        always = {index for index, own in enumerate(folded) if own in _NEVER}
        object.__setattr__(self, "never_assisted", self.never_assisted | always)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def assisted(self) -> tuple[str, ...]:
        """Names of what may be assisted, in order."""
        return tuple(name for index, name in enumerate(self.names) if index not in self.never_assisted)

    def name(self, index: int | None) -> str | None:
        """Of a class; None for no verb."""
        return None if index is None else self.names[index]

    def wire_name(self, index: int | None) -> str:
        """How the DBC calls a class; None is the name for no verb."""
        if index is None:
            return "None"
        name = self.names[index]
        return "Other" if name.casefold() == "other" else name

    def find(self, word: str) -> int | None:
        """The class of that name, whatever its case; what the vocabulary does not have is its `other`, if it has one."""
        wanted = " ".join(word.split()).replace(" / ", "/").casefold()
        known = {name.casefold(): index for index, name in enumerate(self.names)}
        return known.get(wanted, known.get("other"))

    def on_the_bus(self, table: Collection[str]) -> Vocabulary:
        """The same, where what the value table `table` lacks is never assisted."""
        return replace(self, never_assisted=self.never_assisted | set(self._unknown(table)))

    def lacking(self, table: Collection[str]) -> tuple[str, ...]:
        """Verbs that would be assisted, had the value table a code for them."""
        return tuple(self.names[index] for index in self._unknown(table) if index not in self.never_assisted)

    def _unknown(self, table: Collection[str]) -> Iterable[int]:
        return [index for index in range(len(self.names)) if self.wire_name(index) not in table]


DEFAULT = Vocabulary()


def vocabulary_of(rows: Iterable[tuple[str, bool]]) -> Vocabulary:
    """From (verb, whether it may be assisted); verbs of the default take its spelling. Raises ValueError."""
    named = [(_SPELT.get(verb.casefold(), verb), may) for verb, may in rows]
    never = frozenset(index for index, (_, may) in enumerate(named) if not may)
    return Vocabulary(tuple(verb for verb, _ in named), never)


def stored_vocabulary(names: object, assisted: object) -> Vocabulary:
    """From two lists of names as a file has them; what is not called assisted is not. Raises ValueError."""
    if not (isinstance(names, list) and isinstance(assisted, list)):
        raise ValueError("its vocabulary is no list of names")
    if not all(isinstance(name, str) for name in (*names, *assisted)):
        raise ValueError("its vocabulary is no list of names")
    made = vocabulary_of((name, name in assisted) for name in names)
    if list(made.names) != names or list(made.assisted) != assisted:
        raise ValueError(f"it would have {assisted} assisted, which its verbs {names} do not allow")
    return made
