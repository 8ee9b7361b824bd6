"""Flash, RAM and stack of the core: `size.py FOLDER FLASH_LIMIT RAM_LIMIT` reads the objects and .su files of a folder.

Exit 1 where a limit is passed. The stack is the sum along the deepest path of calls that `CALLS` knows.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path


def sizes(folder: Path) -> tuple[int, int]:
    """(flash, RAM) in bytes."""
    objects = sorted(str(path) for path in [*folder.glob("ctl_*.o"), folder / "the_state.o"])
    told = subprocess.run(["arm-none-eabi-size", *objects], capture_output=True, text=True, check=True).stdout
    rows = [[int(word) for word in line.split()[:3]] for line in told.splitlines()[1:]]
    return sum(text + data for text, data, _ in rows), sum(data + bss for _, data, bss in rows)


def frames(folder: Path) -> dict[str, int]:
    """Stack of each function in bytes."""
    found = {}
    for path in folder.glob("ctl_*.su"):
        for line in path.read_text().splitlines():
            place, size, kind = line.split("\t")
            if kind != "static":
                raise SystemExit(f"{place}: its stack is {kind}, so that no bound is known")
            found[place.rsplit(":", 1)[-1]] = int(size)
    return found


def deepest(folder: Path, own: dict[str, int]) -> int:
    """The worst stack below ctl_step, along the calls that the objects show; none of them recurs."""
    calls: dict[str, set[str]] = {}
    command = ["arm-none-eabi-objdump", "-dr", *map(str, sorted(folder.glob("ctl_*.o")))]
    at = ""
    for line in subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines():
        if begins := re.match(r"^[0-9a-f]+ <([\w.]+)>:", line):
            at = begins[1]
        elif goes := re.search(r"R_ARM_THM_(?:CALL|JUMP24)\s+([\w.]+)", line) or re.search(
            r"\sbl?(?:\.w|\.n)?\s+[0-9a-f]+ <([A-Za-z_][\w.]*)>", line
        ):
            calls.setdefault(at, set()).add(goes[1])

    def below(name: str, path: tuple[str, ...] = ()) -> int:
        if name in path:
            raise SystemExit(f"{name} calls itself: {' -> '.join(path)}")
        beneath = [below(one, (*path, name)) for one in calls.get(name, ()) if one != name]
        return own.get(name, 0) + max(beneath, default=0)

    return below("ctl_step")


def main() -> int:
    """Print and judge."""
    folder, flash_limit, ram_limit = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    flash, ram = sizes(folder)
    own = frames(folder)
    stack = deepest(folder, own)
    told = f"flash {flash} of {flash_limit} bytes, RAM {ram} + stack {stack} = {ram + stack} of {ram_limit} bytes\n"
    worst = sorted(own.items(), key=lambda item: -item[1])[:3]
    told += "largest frames: " + ", ".join(f"{name} {size}" for name, size in worst) + "\n"
    sys.stdout.write(told)
    return int(flash > flash_limit or ram + stack > ram_limit)


if __name__ == "__main__":
    sys.exit(main())
