"""The verb vocabulary: the paper's K = 21 classes, 20 frequent EGTEA Gaze+ verbs and a residual `other`.

The order is by frequency in the 15,484 annotations, `other` last. A class index is an index into `VERBS`; the code that
crosses the bus is the one the DBC's value table gives to the same name.
"""

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
