"""How long from a press of the page's STOP to STOP on the bus: `python -m tests.tools.operator.stop_delay --clicks 100`.

A real demo runs on the bus meanwhile: wearer, bridge, device. Chromium presses the button. The way begins at the browser's
own stamp of the press and ends at the bus's stamp of the frame. It is told in two parts, parted where the page's script hears
of the press: what comes before is the browser's, what comes after is ours. With `--loaded N`, N processes compute meanwhile.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from bisect import bisect_left
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from hilbridge.observe.summary import percentile
from tests.system.operator.rig import Ear, chromium, monitor, page_zero_ns

LIMIT_MS = 20.0
_PATIENCE_S = 2.0
_NOTE = """() => {
  window.pressed = [];
  document.getElementById("stop").addEventListener(
    "pointerdown", event => window.pressed.push([event.timeStamp, performance.now()]), true);
}"""


def press(page: Any, ear: Ear, clicks: int) -> list[tuple[float, float]]:
    """For each press: ms from its stamp to the page's script, and from there to the first STOP on the bus."""
    page.evaluate(_NOTE)
    zero_ns, doubt_ns = page_zero_ns(page)
    box = page.locator("#stop").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    for number in range(clicks):
        before = len(ear.stops_ns)
        page.mouse.down()
        page.mouse.up()
        until_s = time.monotonic() + _PATIENCE_S
        while len(ear.stops_ns) < before + 3 and time.monotonic() < until_s:
            page.wait_for_timeout(10)
        page.wait_for_timeout(50 + number * 37 % 100)  # so that presses come at all phases of the page's views
    print(f"the page's clock is known to {doubt_ns / 1e6:.2f} ms")
    found = []
    for stamp_ms, script_ms in page.evaluate("window.pressed"):
        at_ns = zero_ns + round(stamp_ms * 1e6)
        first = bisect_left(ear.stops_ns, at_ns)
        on_bus_ms = (ear.stops_ns[first] - at_ns) / 1e6 if first < len(ear.stops_ns) else float("inf")
        found.append((script_ms - stamp_ms, on_bus_ms - (script_ms - stamp_ms)))
    return found


def figures(values: list[float]) -> dict[str, float]:
    """p50, p99 and max in ms."""
    return {name: round(percentile(values, share) or 0.0, 2) for name, share in (("p50", 0.5), ("p99", 0.99))} | {
        "max": round(max(values), 2)
    }


def measure(clicks: int, loaded: int) -> dict[str, Any]:
    """One run: figures of the whole way, of its parts, and the ways themselves."""
    bus = f"hilsim:stop-{os.getpid()}"
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        ear = Ear(bus)
        stack.callback(ear.close)
        command = [sys.executable, "-m", "hilbridge", "demo", "--bus", bus, "--seconds", str(60 + clicks)]
        demo = subprocess.Popen([*command, "--out", str(Path(folder, "demo")), "--json"], stdout=subprocess.DEVNULL)
        stack.callback(demo.wait, 60)
        stack.callback(demo.terminate)
        url, _ = stack.enter_context(monitor("--bus", bus))
        page = stack.enter_context(chromium()).new_page(viewport={"width": 1280, "height": 900})
        page.goto(url)
        page.wait_for_selector("#state.follow, #state.assist", timeout=60_000)
        for _ in range(loaded):
            busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            stack.callback(busy.wait)
            stack.callback(busy.kill)
        found = press(page, ear, clicks)
    whole = [before + after for before, after in found]
    return {
        "clicks": len(found),
        "whole_ms": figures(whole),
        "browser_ms": figures([before for before, _ in found]),
        "page_to_bus_ms": figures([after for _, after in found]),
        "first_ms": round(whole[0], 2),
        "late": sum(one > LIMIT_MS for one in whole),
        "load": round(os.getloadavg()[0], 1),
    }


def main() -> int:
    """Print the figures; exit code 1 where more than one of a hundred came late."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.operator.stop_delay", description=__doc__)
    parser.add_argument("--clicks", type=int, default=100)
    parser.add_argument("--loaded", type=int, default=0, metavar="N", help="so many processes compute meanwhile")
    options = parser.parse_args()
    found = measure(options.clicks, options.loaded)
    print(json.dumps(found))
    return int(found["late"] > options.clicks / 100)


if __name__ == "__main__":
    sys.exit(main())
