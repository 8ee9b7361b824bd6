"""`python -m tests.safety [PART ...]`: run the proofs of the safety contract and print one table. Exit 1 where one fails."""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from tests.safety.mutation import TARGETS
from tests.safety.parts import LANES, LONGEST_FIRST, PARTS, part
from tests.safety.table import Row, Scale, printed


def main() -> int:
    """Parse, run the parts, print."""
    parser = argparse.ArgumentParser(prog="python -m tests.safety", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"any of {', '.join(PARTS)} (default: all)")
    parser.add_argument("--without", choices=list(PARTS), help="all but this one")
    parser.add_argument("--quick", action="store_true", help="the seeded part that `make test` runs")
    parser.add_argument("--seed", type=int, default=Scale().seed)
    parser.add_argument("--share", type=float, default=1.0, help="share of the random campaigns, 1.0 is all")
    parser.add_argument("--bus", default="auto", help="bus of the hung-bridge campaign: auto, vcan0 or hilsim")
    parser.add_argument("--files", nargs="+", metavar="FILE", default=(), help="mutate these files only")
    options = parser.parse_args()
    unknown = [name for name in options.parts if name not in PARTS]
    if unknown:
        parser.error(f"no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    strangers = [name for name in options.files if name not in TARGETS]
    if strangers:
        parser.error(f"{', '.join(strangers)}: not among the files that are mutated: {', '.join(TARGETS)}")
    scale = Scale(options.quick, options.seed, options.share, options.bus, tuple(options.files))
    wanted = [name for name in options.parts or PARTS if name != options.without]
    found: dict[str, list[Row]] = {}
    computed = [name for name in LONGEST_FIRST if name in wanted]
    with ProcessPoolExecutor(min(len(computed), LANES) or 1, get_context("spawn")) as pool:
        for name, rows in pool.map(part, computed, [scale] * len(computed)):
            found[name] = rows
    for name in wanted:  # those in real time come last and alone
        if name not in found:
            found[name] = part(name, scale)[1]
    rows = [row for name in wanted for row in found[name]]
    print(printed(rows))
    return 0 if all(row.holds for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
