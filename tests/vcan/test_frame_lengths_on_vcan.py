"""Our count of every frame's bits against `canbusload -e` of can-utils, on a hundred thousand random frames."""

from __future__ import annotations

import contextlib
import random
import re
import select
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hilbridge.bus.model.bits import INTERMISSION_BITS, frame_length
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.port.socketcan import pack_can_frame
from hilbridge.records import Frame

FRAMES, CHUNK, ATTEMPTS = 100_000, 1_000, 600
LARGEST_BURST, SMALLEST_BURST = 100, 10
LINE = re.compile(r"vcan0@500000\s+(\d+)\s+(\d+)\s+(\d+)")


class BusLoad:
    """A running canbusload. It prints and forgets its counts on SIGALRM, which we send while the bus is quiet.

    Its own alarm, re-armed by ours, would cut a chunk in two; and its socket holds a few hundred frames only, so a
    chunk that it did not see whole does not count.
    """

    def __init__(self) -> None:
        command = ["stdbuf", "-oL", "canbusload", "-e", "vcan0@500000"]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, bufsize=0)
        self._line()  # its socket is open once it prints

    def _line(self) -> tuple[int, int]:
        assert self._process.stdout is not None
        while True:
            match = LINE.search(self._process.stdout.readline().decode())
            if match:
                return int(match[1]), int(match[2])

    def counted(self) -> tuple[int, int]:
        """Frames and bits since it last printed; what it printed of its own accord before is thrown away."""
        assert self._process.stdout is not None
        while select.select([self._process.stdout], [], [], 0)[0]:
            self._process.stdout.readline()
        self._process.send_signal(signal.SIGALRM)
        return self._line()

    def stop(self) -> None:
        self._process.terminate()
        self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()


@pytest.fixture
def roomy_sockets() -> Iterator[None]:
    """Sockets opened meanwhile hold more, where we may say so: canbusload asks for no more than the default."""
    limit = Path("/proc/sys/net/core/rmem_default")
    before = limit.read_text()
    with contextlib.suppress(OSError):
        limit.write_text("4194304")
    yield
    with contextlib.suppress(OSError):
        limit.write_text(before)


@pytest.fixture
def busload(roomy_sockets: None) -> Iterator[BusLoad]:
    running = BusLoad()
    yield running
    running.stop()


def random_frame(dice: random.Random) -> WireFrame:
    extended = dice.random() < 0.5
    can_id = dice.choice([0, dice.getrandbits(29), 0x1FFF_FFFF] if extended else [0, dice.getrandbits(11), 0x7FF])
    # Long runs of equal bits need many stuff bits; random bytes need few.
    lumps = (0x00, 0xFF, 0x0F, 0xF0, 0x1F, dice.getrandbits(8))
    return WireFrame(can_id, bytes(dice.choice(lumps) for _ in range(dice.randrange(9))), extended)


def send_slowly(can: socket.socket, frames: list[WireFrame], burst: int) -> None:
    """In bursts that a reader's socket can hold, giving the one processor to the reader after each."""
    for start in range(0, len(frames), burst):
        for frame in frames[start : start + burst]:
            can.send(pack_can_frame(Frame(frame.can_id, frame.data, is_extended=frame.is_extended)))
        time.sleep(0.004)
    time.sleep(0.02)


def test_lengths_equal_those_of_canbusload_on_a_hundred_thousand_frames(busload: BusLoad) -> None:
    dice = random.Random(4)
    counted, burst = 0, LARGEST_BURST
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as can:
        can.bind(("vcan0",))
        for _ in range(ATTEMPTS):
            frames = [random_frame(dice) for _ in range(CHUNK)]
            send_slowly(can, frames, burst)
            seen, bits = busload.counted()
            if seen == CHUNK:
                assert bits == sum(frame_length(frame).nominal_bits + INTERMISSION_BITS for frame in frames)
                counted += CHUNK
                burst = min(LARGEST_BURST, burst + 2)
                if counted == FRAMES:
                    break
            else:
                burst = max(SMALLEST_BURST, burst // 2)  # a busy machine: the reader did not keep up
            while busload.counted() != (0, 0):
                time.sleep(0.02)
    assert counted == FRAMES
