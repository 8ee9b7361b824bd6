"""python-can's own programs on the simulated bus, as anybody would start them: can_player and can_logger."""

from __future__ import annotations

import subprocess
import sys
import uuid
from pathlib import Path

import can

from hilbridge.bus.logs import write_log
from hilbridge.records import Frame

WAIT_S = 30.0
START_NS = 1_700_000_000 * 10**9


def test_can_player_plays_a_log_onto_the_bus(tmp_path: Path) -> None:
    name = f"test-{uuid.uuid4()}"
    frames = [
        Frame(0x0A0, bytes([number] * 8), wall_ns=START_NS + number * 1_000_000) for number in range(10)
    ]  # as many as a queue holds: the player never waits for room
    write_log(tmp_path / "trace.log", frames)
    with can.Bus(interface="hilsim", channel=name) as listener:
        command = [sys.executable, "-m", "can.player", "-i", "hilsim", "-c", name, str(tmp_path / "trace.log")]
        subprocess.run(command, check=True, timeout=60, stdout=subprocess.DEVNULL)
        heard = [listener.recv(WAIT_S) for _ in frames]
        assert [bytes(message.data) for message in heard if message] == [frame.data for frame in frames]


def test_can_logger_shows_what_is_on_the_bus() -> None:
    name = f"test-{uuid.uuid4()}"
    with can.Bus(interface="hilsim", channel=name) as sender:
        command = [sys.executable, "-u", "-m", "can.logger", "-i", "hilsim", "-c", name]
        logger = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert logger.stdout is not None
        try:
            # Alone on the bus nobody acknowledges: these wait until the logger has attached.
            for number in range(5):
                sender.send(can.Message(arbitration_id=0x0A0, data=[number], is_extended_id=False))
            shown: list[str] = []
            while len(shown) < 5:
                line = logger.stdout.readline()
                assert line
                shown += [line] if "ID:      0a0" in line else []
            assert [line.split("DL:  1")[1].split()[0] for line in shown] == [f"{number:02x}" for number in range(5)]
        finally:
            logger.kill()
            logger.wait(WAIT_S)
            logger.stdout.close()
