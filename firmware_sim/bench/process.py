"""The plant as a process: a thousand steps a second of arm, motor and wearer on a CAN bus of their own (`hilbridge plant`)."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from types import FrameType
from typing import IO, NoReturn

from firmware_sim.attachment import Attachment, BusUnusable
from firmware_sim.bench.link import attach
from firmware_sim.bench.mechanics import Elbow
from firmware_sim.bench.plant import Plant
from firmware_sim.bench.wire import ANGLE_IDS, MOTION_IDS, TORQUE_ID, read_torque
from firmware_sim.console import say
from firmware_sim.plant.arm import WEARERS
from firmware_sim.priority import use_realtime_scheduling

_STEP_NS = 1_000_000
_LISTEN_S = 0.3
_OURS = (*ANGLE_IDS, *MOTION_IDS)


class PlantUnusable(ValueError):
    """The plant may not run here; the message is one line with the cure."""


class Process:
    """The loop: what arrived, the steps that are due, their frames, sleep. `stopping` ends it."""

    def __init__(self, plant: Plant, bus: Attachment, log: IO[str] | None = None, log_ms: int = 5) -> None:
        self.plant, self.bus = plant, bus
        self.stopping = False
        self._log, self._log_ms = log, log_ms

    def run(self, seconds: float | None, clock: Callable[[], int] = time.monotonic_ns) -> None:
        """For so long, or until told."""
        start_ns = clock()
        last = None if seconds is None else round(seconds * 1000)
        while not self.stopping and (last is None or self.plant.account.steps < last):
            now_ns = clock()
            for arrival in self.bus.read(now_ns):
                torque = read_torque(arrival.frame.data) if arrival.frame.can_id == TORQUE_ID else None
                if torque is not None and arrival.frame.plain:
                    self.plant.hear(torque)
            due_ns = start_ns + (self.plant.account.steps + 1) * _STEP_NS
            if now_ns < due_ns:
                time.sleep((due_ns - now_ns) / 1e9)
                continue
            for can_id, data in self.plant.step(late=now_ns - due_ns >= _STEP_NS):
                self.bus.send(can_id, data, now_ns)
            self._write(due_ns)

    def _write(self, due_ns: int) -> None:
        if self._log is not None and self.plant.account.steps % self._log_ms == 0:
            row = {"ends_ns": due_ns, "torque_nm": [one * 1e-6 for one in self.plant.torque_unm]}
            self._log.write(json.dumps({**row, "silent": self.plant.silent}) + "\n")


def admit(bus: Attachment, text: str, *, on_a_bench: bool) -> None:
    """Raises PlantUnusable for a bus that may reach somebody, unless it is a bench, and for one with company."""
    if bus.spec.physical and not on_a_bench:
        raise PlantUnusable(
            f"bus {text}: may reach a device that somebody wears; take it off, then say --i-am-on-a-bench"
        )
    time.sleep(_LISTEN_S)
    heard = {arrival.frame.can_id for arrival in bus.read(time.monotonic_ns())} - {TORQUE_ID}
    if heard & set(_OURS):
        raise PlantUnusable(f"bus {text}: another plant is on it; end that, or use another bus")
    if heard:
        raise PlantUnusable(
            f"bus {text}: {min(heard):#05x} is no frame of dbc/plant.dbc; give the plant a bus of its own"
        )


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """One line."""
        self.exit(2, f"plant: {' '.join(message.split())}; `hilbridge plant --help` lists what there is\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="plant", description="Arm, motor and wearer in real time on a CAN bus (dbc/plant.dbc).")
    parser.add_argument("--bus", required=True)
    parser.add_argument("--wearer-torque", choices=WEARERS, default="reach")
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--json-log", type=Path)
    parser.add_argument("--i-am-on-a-bench", action="store_true")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """0 after a clean end, 2 with one line where it cannot start."""
    options = _parser().parse_args(arguments)
    bus: Attachment | None = None
    log: IO[str] | None = None
    try:
        bus = attach(options.bus)
        admit(bus, options.bus, on_a_bench=options.i_am_on_a_bench)
        log = None if options.json_log is None else options.json_log.open("w", encoding="utf-8", buffering=1)
        use_realtime_scheduling()
        process = Process(Plant(Elbow(options.wearer_torque)), bus, log)
        _on_signals(process)
        _say(f"ready on {options.bus}")
        process.run(options.seconds)
        told = {**asdict(process.plant.account), "frames_dropped": bus.dropped, "link_errors": bus.link_errors}
        _say(f"done {json.dumps(told)}")
    except (BusUnusable, PlantUnusable) as error:
        say(" ".join(str(error).split()), wrong=True, program="plant")
        return 2
    except OSError as error:
        say(f"{options.json_log}: {error.strerror}; name a file that can be written", wrong=True, program="plant")
        return 2
    finally:
        if bus is not None:
            bus.close()
        if log is not None:
            log.close()
    return 0


def _say(text: str) -> None:
    say(text, program="plant")


def _on_signals(process: Process) -> None:
    def stop(_signal: int, _frame: FrameType | None) -> None:
        process.stopping = True

    def press(_signal: int, _frame: FrameType | None) -> None:
        process.plant.press_steps = 1

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    if hasattr(signal, "SIGUSR1"):
        signal.signal(signal.SIGUSR1, press)


if __name__ == "__main__":
    sys.exit(main())
