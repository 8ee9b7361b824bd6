"""The process of a simulated bus under attack: fuzzed requests and hostile connections, an honest pair meanwhile.

The server lives, its memory stays flat, every request is answered, no honest frame is lost. How long an honest round
trip takes is measured in the full run only.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import select
import socket
import subprocess
import sys
import time
import uuid
from collections import deque
from pathlib import Path
from typing import Any

from hilbridge.bus.simulated.client import BusClient, BusNotReachable
from hilbridge.bus.simulated.protocol import RECORD_BYTES, Kind
from tests.safety.server.patterns import PATTERNS, Target
from tests.safety.server.requests import fuzzed
from tests.safety.table import Row, Scale

ROOT = Path(__file__).parents[3]
GROWTH_LIMIT_MB = 20.0
ROUND_TRIP_LIMIT_MS = 5.0
_FUZZERS = 8
_HELD = 600  # sockets that patterns leave open; the oldest are closed
_BATCH = 40
_PATIENCE_S = 60.0


class Attacked:
    """A server process and an honest pair on it."""

    def __init__(self) -> None:
        self.name = f"attacked-{uuid.uuid4()}"
        command = [sys.executable, "-m", "hilbridge.bus.simulated.server", self.name]
        command += ["--bitrate", "1000000", "--linger", "60"]  # honest clients come and go
        self.server = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.server.stdout is not None
        self.server.stdout.readline()
        self.honest = self._honest()
        with contextlib.closing(BusClient(self.name, start=False)) as client:
            for _ in range(50):  # what is made once is made before memory is looked at
                client.control({"op": "status"})
                client.control({"op": "fly"})
            self.address = client._receive.getpeername()
        self.before_mb = self.peak_mb = self.memory_mb()

    def _honest(self, *options: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "tests.safety.server.honest", self.name, *options]
        honest = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert honest.stdout is not None
        honest.stdout.readline()
        return honest

    def memory_mb(self) -> float:
        """Resident memory of the server; 0 where the system does not tell, or where it has died."""
        try:
            pages = int(Path(f"/proc/{self.server.pid}/statm").read_text().split()[1])
        except (OSError, IndexError):
            return 0.0
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

    def look(self) -> None:
        """Keep the highest memory seen."""
        self.peak_mb = max(self.peak_mb, self.memory_mb())

    def honest_found(self) -> dict[str, Any]:
        """What the honest pair has seen up to now; a new pair goes on."""
        said, _ = self.honest.communicate("enough\n", timeout=_PATIENCE_S)
        found: dict[str, Any] = json.loads(said)
        return found

    def again(self, *options: str) -> None:
        """A new honest pair for the next kind of attack."""
        self.honest = self._honest(*options)

    def end(self) -> bool:
        """Whether the server still lives and serves; it is ended afterwards."""
        alive = self.server.poll() is None
        try:
            with contextlib.closing(BusClient(self.name, start=False)) as client:
                alive = alive and "nodes" in client.control({"op": "status"}, _PATIENCE_S)
        except (OSError, BusNotReachable):
            alive = False
        self.server.terminate()
        _, said = self.server.communicate(timeout=_PATIENCE_S)
        if said.strip():
            print(said[-2000:], file=sys.stderr)
        return alive


class Fuzzer:
    """One attached client that sends fuzzed requests as fast as they are taken, and reads all answers."""

    def __init__(self, name: str, number: int, seed: int, *, wild: bool) -> None:
        self.client = BusClient(name, node=f"fuzz {number}", start=False)
        self.out, self.news = self.client._transmit, self.client._receive
        self.rng = random.Random(f"{seed} {number} {wild}")
        self.wild = wild
        self.raw = b""
        self.partial = b""
        self.expected = self.answered = 0

    def work(self, count: int) -> int:
        """Send what the bus takes, at most `count` requests more; gives how many were begun."""
        begun = 0
        if not self.raw and count > 0:
            made = [fuzzed(self.rng, wild=self.wild) for _ in range(min(count, _BATCH))]
            self.raw = b"".join(raw for raw, _ in made)
            self.expected += sum(answers for _, answers in made)
            begun = len(made)
        if self.raw:
            with contextlib.suppress(BlockingIOError):
                self.raw = self.raw[self.out.send(self.raw) :]
        return begun

    def hear(self) -> None:
        """Read what has come; answers are counted."""
        with contextlib.suppress(BlockingIOError):
            while len(self.news.recv(1 << 16)) == 1 << 16:
                pass
        with contextlib.suppress(BlockingIOError):
            raw = self.partial + self.out.recv(1 << 16)
            whole = len(raw) // RECORD_BYTES * RECORD_BYTES
            self.partial = raw[whole:]
            for start in range(0, whole, RECORD_BYTES):
                self.answered += raw[start] == Kind.ANSWER and raw[start + 3] == 0

    @property
    def is_done(self) -> bool:
        """All is sent and answered."""
        return not self.raw and self.answered >= self.expected


def fuzz(bus: Attacked, count: int, seed: int, *, wild: bool) -> tuple[int, int]:
    """So many requests; gives the control requests among them and how many were answered."""
    fuzzers = [Fuzzer(bus.name, number, seed, wild=wild) for number in range(_FUZZERS)]
    left, turns = count, 0
    quiet_s = time.monotonic() + _PATIENCE_S
    while (left > 0 or not all(fuzzer.is_done for fuzzer in fuzzers)) and time.monotonic() < quiet_s:
        streams = [stream for fuzzer in fuzzers for stream in (fuzzer.out, fuzzer.news)]
        writers = [fuzzer.out for fuzzer in fuzzers if fuzzer.raw or left > 0]
        select.select(streams, writers, [], 0.1)
        before = sum(fuzzer.answered for fuzzer in fuzzers)
        for fuzzer in fuzzers:
            left -= fuzzer.work(left)
            fuzzer.hear()
        if left > 0 or sum(fuzzer.answered for fuzzer in fuzzers) > before:
            quiet_s = time.monotonic() + _PATIENCE_S
        turns += 1
        if turns % 256 == 0:
            bus.look()
    fuzzers[0].client.control({"op": "faults", "faults": {}}, _PATIENCE_S)
    for fuzzer in fuzzers:
        fuzzer.client.close()
    return sum(fuzzer.expected for fuzzer in fuzzers), sum(fuzzer.answered for fuzzer in fuzzers)


def assault(bus: Attacked, count: int, seed: int) -> int:
    """So many hostile patterns; gives how many were cut short by the bus, which is its right."""
    rng, target = random.Random(seed), Target(bus.name, bus.address)
    held: deque[socket.socket] = deque()
    refused = 0
    for number in range(count):
        try:
            held.extend(PATTERNS[number % len(PATTERNS)](target, rng))
        except OSError:
            refused += 1
        while len(held) > _HELD:
            held.popleft().close()
        bus.look()
    for stream in held:
        stream.close()
    return refused


def _trips(found: dict[str, Any], kind: str) -> Row:
    trip = found[kind]
    figure = f"{trip['count']} trips, {trip['lost']} lost, p50 {trip['p50_ms']:.2f} ms, p99 {trip['p99_ms']:.2f} ms"
    what = {"frames": "frame there and back", "questions": "request and answer"}[kind]
    holds = trip["lost"] == 0 and trip["p99_ms"] <= ROUND_TRIP_LIMIT_MS
    return Row("server", f"an honest {what} meanwhile: p99 <= {ROUND_TRIP_LIMIT_MS:.0f} ms", figure, holds)


def _measured(found: dict[str, Any], scale: Scale, kinds: tuple[str, ...]) -> list[Row]:
    """Times are for the full run; no frame may be lost in any."""
    if scale.quick:
        lost = sum(found[kind]["lost"] for kind in kinds)
        trips = sum(found[kind]["count"] for kind in kinds)
        return [Row("server", "an honest pair meanwhile: nothing lost", f"{trips} trips, {lost} lost", lost == 0)]
    return [_trips(found, kind) for kind in kinds]


def run(scale: Scale) -> list[Row]:
    """Fuzzed requests that harm only the fuzzers' nodes, then hostile connections, then faults that harm everybody."""
    bus = Attacked()
    if hasattr(os, "nice") and not scale.quick:
        os.nice(5)  # an attacker does not run before the bus and its honest clients
    count, patterns = scale.of(900_000, 3_000), scale.of(500, 44)
    asked, answered = fuzz(bus, count, scale.seed, wild=False)
    rows = [
        Row("server", "fuzzed requests: every one answered", f"{count}, {asked - answered} without", asked == answered)
    ]
    rows += _measured(bus.honest_found(), scale, ("frames", "questions"))
    bus.again()
    refused = assault(bus, patterns, scale.seed)
    figure = f"{patterns} patterns, {refused} refused"
    rows += [Row("server", "hostile connections", figure, True)]
    rows += _measured(bus.honest_found(), scale, ("frames", "questions"))
    bus.again("questions")
    wild = scale.of(100_000, 1_000)
    asked, answered = fuzz(bus, wild, scale.seed, wild=True)
    figure = f"{wild}, {asked - answered} without"
    rows += [Row("server", "and with faults that harm everybody: every one answered", figure, asked == answered)]
    rows += _measured(bus.honest_found(), scale, ("questions",))
    growth_mb, alive = bus.peak_mb - bus.before_mb, bus.end()
    claim = f"server alive, memory grows by <= {GROWTH_LIMIT_MB:.0f} MB"
    figure = f"{'alive' if alive else 'dead'}, {bus.before_mb:.1f} -> {bus.peak_mb:.1f} MB"
    return [*rows, Row("server", claim, figure, alive and growth_mb <= GROWTH_LIMIT_MB)]
