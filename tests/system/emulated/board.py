"""The emulated board: its image built, the emulator started, its CAN line, the hand at it, and what its laboratory tells."""

from __future__ import annotations

import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

HOME = Path(__file__).parents[3] / "firmware_sim" / "c" / "port" / "mps2_an386"
TOOLS = ("make", "arm-none-eabi-gcc", "qemu-system-arm")
MISSING = [tool for tool in TOOLS if shutil.which(tool) is None]
OPENS_S = 30.0


@dataclass
class Board:
    """`spec` is its bus for the port; `told` are the lines of the laboratory, as they come."""

    spec: str
    hand: socket.socket
    told: list[list[str]] = field(default_factory=list)

    def press(self) -> None:
        """The button, once."""
        self.hand.sendall(b"c")

    def listen(self) -> None:
        """Gather what it tells until it ends."""
        for line in self.hand.makefile(encoding="ascii"):
            self.told.append(line.split())


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _connected(port: int) -> socket.socket:
    end_s = time.monotonic() + OPENS_S
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port))
        except OSError:
            assert time.monotonic() < end_s, "the emulator does not listen"
            time.sleep(0.05)


@contextmanager
def emulated(folder: Path, *options: str, lab: bool = False, key: str = "hilbridge-demo-k") -> Iterator[Board]:
    """The board in the emulator, for as long as this lasts; `options` go to QEMU."""
    image = folder / ("lab.elf" if lab else "mps2_an386.elf")
    make = ["make", "-s", "-C", str(HOME), f"OUT={folder}", f"KEY={key}", *(["lab"] if lab else [])]
    subprocess.run(make, check=True, capture_output=True)
    line, hand = free_port(), free_port()
    command = ["qemu-system-arm", "-M", "mps2-an386", "-nographic", "-monitor", "none", "-kernel", str(image)]
    command += [*options, "-serial", f"tcp:127.0.0.1:{line},server,nowait,nodelay"]
    command += ["-serial", f"tcp:127.0.0.1:{hand},server,nowait,nodelay"]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL) as emulator:
        try:
            with _connected(hand) as button:
                board = Board(f"slcan:socket://127.0.0.1:{line}", button)
                threading.Thread(target=board.listen, daemon=True).start()
                yield board
        finally:
            emulator.kill()
