"""The life cycle of the bridge's process in a live run: hung, stalled, killed, started again without any memory."""

from __future__ import annotations

import signal
from pathlib import Path

from hilbridge.bus.port.spec import BusSpec
from hilscenario.format.schema import Scenario
from hilscenario.live.bridge.process import Job, Order
from hilscenario.live.processes import BridgeHandle

# What a bridge is while one of these is under way, or since.
AWAY = {"bridge.hang": "hung", "bridge.stall": "stalled", "bridge.kill": "dead", "bridge.restart": "dead"}


class BridgeLife:
    """The present process is `handle`; `dead` while there is none that was told to tick."""

    def __init__(
        self, scenario: Scenario, spec: BusSpec, folder: Path, key_file: Path | None = None, *, on_a_bench: bool = False
    ) -> None:
        self._scenario, self._spec, self._folder = scenario, spec, folder
        self._key_file, self._on_a_bench = key_file, on_a_bench
        self._born = 0
        self.dead = False
        self.handle = self._start()

    def _start(self) -> BridgeHandle:
        self._born += 1
        log = self._folder / f"bridge-{self._born}.jsonl"
        return BridgeHandle(Job(self._scenario, self._spec, log, self._key_file, self._on_a_bench))

    def order(self, order: Order) -> None:
        """Tell the process; a dead one is not told."""
        self.handle.order(order)

    def hang(self) -> None:
        """Suspend the process."""
        self.handle.signal(signal.SIGSTOP)

    def go_on(self) -> None:
        """Resume the process."""
        self.handle.signal(signal.SIGCONT)

    def kill(self) -> bool:
        """End it in the middle of what it does; True when it was alive and is not now."""
        was_alive = self.handle.alive
        self.handle.kill()
        self.dead = True
        return was_alive and not self.handle.alive

    def start_again(self) -> None:
        """Start another process, which waits for `go`. The rows of the old one must have been read."""
        self.handle.rows.close()
        self.handle = self._start()

    def go(self, start_ns: int, faults: tuple[tuple[int, int], ...] = ()) -> bool:
        """Let the process tick, with these faults of its own under way; False where it has not started yet."""
        if not self.handle.ready:
            return False
        self.dead = False
        self.order(("go", start_ns, faults))
        return True
