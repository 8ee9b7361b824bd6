"""The parts of `make safety`, by name."""

from __future__ import annotations

import os
import sys
import time

from tests.safety import campaign, checking, harm, mutation
from tests.safety.processes import hung
from tests.safety.server import run as server
from tests.safety.table import REFERENCE, Row, Scale
from tests.safety.tools import planted
from tests.safety.tools.branches import run as branches
from tests.safety.tools.c import fuzz as c_fuzz
from tests.safety.tools.c import mutation as c_mutation
from tests.safety.tools.c import twin
from tests.safety.wire import conformance, corruption, forgery, fuzz, replay

PARTS = {
    "corruption": corruption.run,
    "conformance": conformance.run,
    "replay": replay.run,
    "forgery": forgery.run,
    "model": checking.run,
    "model_c": checking.in_c,
    "twin": twin.run,
    "mutation_c": c_mutation.run,
    "fuzz_c": c_fuzz.run,
    "harm": harm.run,
    "fuzz": fuzz.run,
    "branches": branches,
    "mutation": mutation.run,
    "defects": planted.run,
    "campaign": campaign.run,  # takes all cores by itself
    "hung": hung.run,
    "server": server.run,
}


# Everything that only computes, two parts at a time; `hung` and `server` run in real time and have the machine to themselves.
LONGEST_FIRST = (
    "mutation",
    "mutation_c",
    "harm",
    "model",
    "model_c",
    "twin",
    "defects",
    "fuzz",
    "fuzz_c",
    "replay",
    "forgery",
    "branches",
    "conformance",
    "corruption",
)
LANES = 2


def part(name: str, scale: Scale) -> tuple[str, list[Row]]:
    """Run one part, and say how long it took."""
    started = time.monotonic()
    if name == "mutation":
        os.environ.update(REFERENCE)
    rows = PARTS[name](scale)
    print(f"{name}: {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
    return name, rows
