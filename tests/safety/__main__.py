"""`python -m tests.safety [PART ...]`: run the proofs of issue 3 and print one table. Exit 1 when a claim does not hold."""

from __future__ import annotations

import argparse
import sys
import time

from tests.safety import campaign, checking, conformance, corruption, forgery, fuzz, hung, mutation, replay
from tests.safety.branches import run as branches
from tests.safety.table import Row, Scale, printed

PARTS = {
    "corruption": corruption.run,
    "conformance": conformance.run,
    "replay": replay.run,
    "forgery": forgery.run,
    "model": checking.run,
    "fuzz": fuzz.run,
    "branches": branches,
    "mutation": mutation.run,
    "campaign": campaign.run,
    "hung": hung.run,
}


def main() -> int:
    """Parse, run the parts, print."""
    parser = argparse.ArgumentParser(prog="python -m tests.safety", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"any of {', '.join(PARTS)} (default: all)")
    parser.add_argument("--quick", action="store_true", help="the seeded part that `make test` runs")
    parser.add_argument("--seed", type=int, default=Scale().seed)
    parser.add_argument("--share", type=float, default=1.0, help="share of the random campaigns, 1.0 is all")
    parser.add_argument("--bus", default="auto", help="bus of the hung-bridge campaign: auto, vcan0 or hilsim")
    options = parser.parse_args()
    unknown = [part for part in options.parts if part not in PARTS]
    if unknown:
        parser.error(f"no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    scale = Scale(options.quick, options.seed, options.share, options.bus)
    rows: list[Row] = []
    for part in options.parts or PARTS:
        started = time.monotonic()
        print(f"{part} ...", end="", file=sys.stderr, flush=True)
        rows += PARTS[part](scale)
        print(f" {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
    print(printed(rows))
    return 0 if all(row.holds for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
