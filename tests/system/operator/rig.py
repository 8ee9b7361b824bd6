"""What tests and tools around the operator's page share: the program, a browser, an ear on the bus, one clock for both."""

from __future__ import annotations

import contextlib
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hilbridge.bus.simulated.client import BusClient

TOKEN = "t" * 32
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
STOP_ID, HEARTBEAT_ID = 0x001, 0x120


class Ear:
    """Hears a simulated bus beside the page: STOP, and gaze lost, by the bus's own stamps on `time.monotonic_ns`."""

    def __init__(self, bus: str) -> None:
        self._client = BusClient(bus.removeprefix("hilsim:"), node="ear", listen_only=True)
        self._end = threading.Event()
        self.stops_ns: list[int] = []
        self.gaze_lost_ns: list[int] = []
        self._gaze = True
        self._thread = threading.Thread(target=self._hear, daemon=True)
        self._thread.start()

    def _hear(self) -> None:
        while not self._end.is_set():
            if not self._client.wait_readable(0.1):
                continue
            while (arrival := self._client.receive()) is not None:
                if arrival.frame.can_id == STOP_ID:
                    self.stops_ns.append(arrival.stamp_ns)
                elif arrival.frame.can_id == HEARTBEAT_ID:
                    gaze = bool(arrival.frame.data[3] & 1)
                    if self._gaze and not gaze:
                        self.gaze_lost_ns.append(arrival.stamp_ns)
                    self._gaze = gaze

    def close(self) -> None:
        """Leave the bus."""
        self._end.set()
        self._thread.join()
        self._client.close()


def page_zero_ns(page: Any, asks: int = 200) -> tuple[int, int]:
    """What `performance.now() == 0` was on `time.monotonic_ns`, and how far that may be wrong.

    Both are the kernel's monotonic clock, so the bounds of all questions hold at once.
    """
    least, most = -(2**63), 2**63
    for _ in range(asks):
        before_ns = time.monotonic_ns()
        there_ns = round(page.evaluate("performance.now()") * 1e6)
        after_ns = time.monotonic_ns()
        least, most = max(least, before_ns - there_ns), min(most, after_ns - there_ns)
    return (least + most) // 2, (most - least) // 2


@contextlib.contextmanager
def monitor(*arguments: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The program itself: its page's address. Ends it by Ctrl-C, which must end it cleanly."""
    command = [sys.executable, "-m", "hilbridge", "monitor", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        found = re.search(r"http\S+", process.stdout.readline())
        assert found is not None
        try:
            yield found[0], process
        finally:
            process.send_signal(signal.SIGINT)
            assert process.wait(10) == 0


@contextlib.contextmanager
def chromium() -> Iterator[Any]:
    """A browser without a window."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as started:
        opened = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


def write_token(folder: Path) -> Path:
    """A token file as the program wants it."""
    path = folder / "token"
    path.write_text(TOKEN)
    path.chmod(0o600)
    return path
