"""The reference port on an emulated Cortex-M4: boots, arms with the bridge's own code, acts, holds, latches, is cleared."""

from __future__ import annotations

import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest

from firmware_sim.states import State
from hilbridge.core.bridge import Bridge, BridgeConfig
from hilbridge.limits import MS
from hilbridge.records import Action, Frame, GateDecision, HoldReason
from hilbridge.wire.codec import Codec, Decoded
from hilbridge.wire.keys import DEMO_KEY
from hilbridge.wire.link import WireLink
from hilbridge.wire.secoc import Authenticator
from tests.safety.rig import ACT_POUR, HOLD

HOME = Path(__file__).parents[2] / "firmware_sim" / "c" / "port" / "mps2_an386"
TOOLS = ("make", "arm-none-eabi-gcc", "qemu-system-arm")
MISSING = [tool for tool in TOOLS if shutil.which(tool) is None]
pytestmark = pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)}")
ACT_OPERATE = GateDecision(Action.ACT, 13, 0.9, HoldReason.NONE)
_PERIOD_NS = 40 * MS


class Board:
    """The emulated board on its serial line, and a bridge that speaks to it in real time."""

    def __init__(self, bus: can.BusABC) -> None:
        self.bus = bus
        self.wire = WireLink(Codec())
        numbers = iter(range(0x1234, 0x8000))
        self.bridge = Bridge(self.wire, Authenticator(DEMO_KEY), lambda: next(numbers), BridgeConfig(), dict)
        self.decision: GateDecision | None = HOLD
        self.speaks = True
        self.state, self.assist_zero = State.BOOT, True
        self.assisted = False
        self._next_ns = time.monotonic_ns()

    def until(self, true: Callable[[], bool], what: str, limit_s: float = 60.0) -> None:
        """Run until that is so."""
        end_s = time.monotonic() + limit_s
        while not true():
            assert time.monotonic() < end_s, f"{what}: still {self.state.name} after {limit_s} s"
            self._once()

    def _once(self) -> None:
        now_ns = time.monotonic_ns()
        if self.speaks and now_ns >= self._next_ns:
            self._next_ns = now_ns + _PERIOD_NS
            self.bridge.begin_tick(now_ns)
            self._send(self.bridge.tick(self.decision, now_ns - 20 * MS, (True, True, True), 7, now_ns))
        message = self.bus.recv(0.002)
        if message is not None:
            self._hear(Frame(message.arbitration_id, bytes(message.data), received_ns=time.monotonic_ns()))

    def _send(self, frames: list[Frame]) -> None:
        for frame in frames:
            self.bus.send(can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False))

    def _hear(self, frame: Frame) -> None:
        message = self.wire.decode(frame)
        if not isinstance(message, Decoded):
            return
        now_ns = time.monotonic_ns()
        self._send(self.bridge.on_message(message.name, message.signals, message.counter, now_ns))
        if message.name == "CTRL_STATUS":
            self.state = State(frame.data[3] & 0xF)
            self.assist_zero = bool(frame.data[7] >> 6 & 1)
            self.assisted |= self.state is State.ASSIST and not self.assist_zero

    def is_in(self, *states: State) -> Callable[[], bool]:
        return lambda: self.state in states


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def opened(port: int, limit_s: float = 30.0) -> can.BusABC:
    """The serial line, once the emulator listens."""
    end_s = time.monotonic() + limit_s
    while True:
        try:
            return can.Bus(interface="slcan", channel=f"socket://127.0.0.1:{port}", bitrate=500_000, sleep_after_open=0)
        except (can.CanError, OSError):
            assert time.monotonic() < end_s, "the emulator does not listen"
            time.sleep(0.1)


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    subprocess.run(["make", "-s", "-C", str(HOME), f"OUT={tmp_path}"], check=True, capture_output=True)
    port = free_port()
    command = ["qemu-system-arm", "-M", "mps2-an386", "-nographic", "-monitor", "none"]
    command += ["-kernel", str(tmp_path / "mps2_an386.elf"), "-serial", f"tcp:127.0.0.1:{port},server,nowait"]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL) as emulator:
        try:
            with opened(port) as bus:
                yield Board(bus)
        finally:
            emulator.kill()


@pytest.mark.timeout(300)
def test_it_boots_arms_acts_holds_and_latches(board: Board) -> None:
    board.until(board.is_in(State.FOLLOW), "boots")
    board.until(board.is_in(State.READY), "arms")
    board.decision = ACT_OPERATE
    board.until(lambda: board.assisted, "acts")
    board.decision = HOLD
    board.until(lambda: board.state is State.READY and board.assist_zero, "holds")
    board.decision = ACT_POUR
    board.until(board.is_in(State.ASSIST), "acts again")
    board.speaks = False  # a hung bridge
    board.until(lambda: board.state is State.FOLLOW and board.assist_zero, "falls back to following")
    board.speaks, board.decision = True, HOLD
    board.until(board.is_in(State.READY), "is armed anew")
    board.bus.send(can.Message(arbitration_id=1, data=b"", is_extended_id=False))
    board.until(board.is_in(State.ESTOP), "stops")
    assert board.assist_zero
