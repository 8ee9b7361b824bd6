"""Monitor and pages for long: `python -m tests.tools.operator.page_soak --minutes 30`. Does anything grow?

A bridge with a device shares its pictures; two pages of real Chromium show them. One page is loaded anew at seeded instants;
once, after a fifth of the time, the monitor ends and is started again, and both pages must find it. From two fifths of the
time on nothing may grow: the monitor's memory, the pages' heaps after a collection, and their nodes. The memory of Chromium
itself is that of another one, which nobody drives: for whoever drives it, it keeps all that it has fetched. At the end STOP
must still go out. Exit code 1 where any of it fails.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from hilbridge.demo import DeviceProcess
from tests.system.operator.rig import CHROMIUM, Ear, chromium, monitor, write_token
from tests.tools.recording_cost import make_inputs

SEED = 18
_WARM = 0.4  # share of the time
# What each may grow by, first to last third of the time after it was warm.
LIMITS = {
    "server_mb": 5.0,
    "heap_mb": 2.0,
    "nodes": 1000.0,
    "browser_mb": 60.0,
}  # nodes: a log of 100 lines on each page


@dataclass
class Grown:
    """Samples of one measure each, and what went wrong beside them."""

    server_mb: list[float] = field(default_factory=list)
    heap_mb: list[float] = field(default_factory=list)
    nodes: list[float] = field(default_factory=list)
    browser_mb: list[float] = field(default_factory=list)
    reloads: int = 0
    pictures: int = 0
    problems: list[str] = field(default_factory=list)

    def growth(self) -> dict[str, float]:
        """Median of the last third minus that of the first, of what came after it was warm."""
        found = {}
        for name in LIMITS:
            values: list[float] = getattr(self, name)
            warm = values[int(_WARM * len(values)) :]
            width = max(1, len(warm) // 3)
            found[name] = round(median(warm[-width:]) - median(warm[:width]), 2)
        return found

    def judge(self) -> list[str]:
        """Why it is not well."""
        return self.problems + [f"{n} grew by {by}" for n, by in self.growth().items() if by > LIMITS[n]]


def memory_mb(process_id: int) -> float:
    """What one process holds that is no file's; 0 where it has gone."""
    try:
        lines = Path(f"/proc/{process_id}/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return 0.0
    return sum(int(line.split()[1]) for line in lines if line.startswith(("RssAnon", "RssShmem"))) / 1e3


def with_children(process_id: int) -> list[int]:
    """A process and all that it has started, and they."""
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with suppress(OSError, IndexError):
                parents[int(entry.name)] = int(
                    (entry / "stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[1]
                )
    found = [process_id]
    for parent in found:
        found += [child for child, of in parents.items() if of == parent]
    return found


@contextmanager
def undriven(url: str, folder: Path) -> Iterator[int]:
    """A browser that shows the page and that nobody drives; its process."""
    assert CHROMIUM is not None
    command = [CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder}", url]
    silent = subprocess.DEVNULL
    with subprocess.Popen(command, stdout=silent, stderr=silent, start_new_session=True) as browser:
        try:
            yield browser.pid
        finally:
            browser.terminate()


class Pages:
    """Two pages of one browser, and what they hold."""

    def __init__(self, browser: Any, url: str) -> None:
        self._pages = [browser.new_page(viewport={"width": 1280, "height": 900}) for _ in range(2)]
        self.errors: list[str] = []
        for page in self._pages:
            page.on("pageerror", lambda error: self.errors.append(str(error)))
            page.goto(url)
        self._sessions = [page.context.new_cdp_session(page) for page in self._pages]

    def reload(self) -> None:
        """The second one."""
        self._pages[1].reload()

    def wait(self, seconds: float) -> None:
        """Let the browser work."""
        self._pages[0].wait_for_timeout(1000 * seconds)

    def show(self, selector: str) -> None:
        """Wait until both show it."""
        for page in self._pages:
            page.wait_for_selector(selector, timeout=60_000)

    def pictures(self) -> int:
        """How many of both show the camera."""
        return sum(page.is_visible("#overlay .gaze") for page in self._pages)

    def stop(self) -> None:
        """Press it."""
        self._pages[0].click("#stop")
        self._pages[0].wait_for_selector("#stop-said:text-is('STOP sent three times.')")

    def sample(self, grown: Grown) -> None:
        """What both hold now, after a collection."""
        heap = nodes = 0.0
        for session in self._sessions:
            session.send("HeapProfiler.collectGarbage")
            counts = session.send("Memory.getDOMCounters")
            heap += session.send("Runtime.getHeapUsage")["usedSize"] / 1e6
            nodes += counts["nodes"]
        grown.heap_mb.append(heap)
        grown.nodes.append(nodes)


def soak(minutes: float, every_s: float) -> Grown:
    """One run."""
    grown, bus = Grown(), f"hilsim:pages-{os.getpid()}"
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        os.environ["XDG_RUNTIME_DIR"] = str(folder)
        film = make_inputs(folder)
        device = DeviceProcess(bus, folder / "device.jsonl")
        stack.callback(device.stop)
        ear = Ear(bus)
        stack.callback(ear.close)
        command = [sys.executable, "-m", "hilbridge", "run", "--camera", str(film), "--gaze", str(folder / "gaze.csv")]
        command += [
            "--loop",
            "--no-hands",
            "--no-video",
            "--share-pictures",
            "--bus",
            bus,
            "--out",
            str(folder / "run"),
        ]
        bridge = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        stack.callback(bridge.wait, 60)
        stack.callback(bridge.terminate)
        browser = stack.enter_context(chromium())
        _show(grown, browser, bus, folder, minutes * 60, every_s)
        if len(ear.stops_ns) != 3:
            grown.problems.append(f"STOP came {len(ear.stops_ns)} times")
    return grown


def _show(grown: Grown, browser: Any, bus: str, folder: Path, seconds: float, every_s: float) -> None:
    """Serve it, once again, and look."""
    begin_s, chance = time.monotonic(), random.Random(SEED)
    arguments = ["--bus", bus, "--token-file", str(write_token(folder))]
    with ExitStack() as stack:
        with monitor(*arguments) as (url, process):
            pages, other = Pages(browser, url), stack.enter_context(undriven(url, folder / "undriven"))
            pages.show("#state.follow")
            _look(grown, pages, (process.pid, other), begin_s + seconds / 5, every_s, chance)
        pages.show("#name:text-is('NO CONNECTION')")
        port = url.split(":")[2].split("/")[0]
        _, process = stack.enter_context(monitor(*arguments, "--port", port))
        pages.show("#state.follow")
        _look(grown, pages, (process.pid, other), begin_s + seconds, every_s, chance)
        if pages.pictures() < 2:
            grown.problems.append("a page has no picture at the end")
        pages.stop()
        grown.problems += pages.errors


def _look(
    grown: Grown, pages: Pages, processes: tuple[int, int], until_s: float, every_s: float, chance: random.Random
) -> None:
    server, browser = processes
    while time.monotonic() < until_s:
        if chance.random() < 0.2:
            pages.reload()
            grown.reloads += 1
        pages.wait(every_s)
        pages.sample(grown)
        grown.server_mb.append(memory_mb(server))
        grown.browser_mb.append(sum(map(memory_mb, with_children(browser))))
        grown.pictures += pages.pictures()


def main() -> int:
    """Run, print, judge."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.operator.page_soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--every-s", type=float, default=5.0, help="between samples")
    parser.add_argument("--json", action="store_true", help="every sample, too")
    options = parser.parse_args()
    grown = soak(options.minutes, options.every_s)
    problems = grown.judge()
    if options.json:
        print(json.dumps(asdict(grown)))
    last = {name: round(getattr(grown, name)[-1], 1) for name in LIMITS}
    print(f"at the end {last}; grown by {grown.growth()}; {grown.reloads} reloads, {grown.pictures} looks at a picture")
    print("; ".join(problems) or "well")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
