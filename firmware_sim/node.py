"""`firmware-sim`: the device as a process of its own on any python-can bus. Clock, bus and signals live here only.

The control loop owes one tick per millisecond. After a stall of the computer it catches up tick by tick, every frame
in the tick in which it arrived, so that a stalled computer is not mistaken for a stalled device; it counts these ticks.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import secrets
import signal
import sys
import threading
import time
from collections import deque
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from types import FrameType
from typing import IO, NoReturn

from firmware_sim.attachment import Arrival, Attachment, BusUnusable, parse_spec
from firmware_sim.bench.link import LinkedDevice, attach
from firmware_sim.bench.remote import RemoteDevice
from firmware_sim.clearing import HAND, awaited
from firmware_sim.console import listen, read_terminal_politely, report_defect, say
from firmware_sim.controllers import CONTROLLERS, ControllerUnusable, power_on
from firmware_sim.device import LOG_CYCLE_MS, Device
from firmware_sim.frames import STOP, Reject
from firmware_sim.keys import WRONG, KeyUnusable, load_key
from firmware_sim.memory import COUNT_LOST, COUNT_STALL_TICKS, COUNT_TRIPS, Refusal
from firmware_sim.plant.arm import WEARERS
from firmware_sim.priority import use_realtime_scheduling
from firmware_sim.profile_file import ProfilesUnusable, read_own
from firmware_sim.states import wire_name

_TICK_NS = 1_000_000
_WAKE_NS = 2 * _TICK_NS  # frames carry their time of arrival, so waking less often changes no tick
_STALL_TICKS = 7
_STALE_TICKS = 60  # what a tick further back wanted to send describes nothing any more
_REFUSED = {
    Refusal.KEY: "wrong MAC, the bridge has another key; give both the same --key-file",
    Refusal.DISTURBED: "two asked at once, a second bridge or a stranger; the bridge tries again",
    Refusal.LATE: "an answer too late, or to no challenge; the bridge tries again",
}
_COMMANDS = (
    "clear | overrun [MS] | stuck | gain X | lag MS | bias NM | mend | encoder MDEG | push NM | busoff | buson |"
    " restart | wrongkey | quit"
)


class Node:
    """The loop: read, run the ticks that are due, send, log, sleep to the next tick."""

    def __init__(
        self, device: Device | RemoteDevice, bus: Attachment, log: IO[str] | None, log_cycle_ms: int = LOG_CYCLE_MS
    ) -> None:
        """`log` is an open text file for JSON lines, or None; `log_cycle_ms` how often it has a line at least."""
        self.device = device
        self.bus = bus
        self.log = log
        self._key = device.state.shared_key
        self.stopping = False
        self.commands: deque[str] = deque()
        self.most_behind = 0
        self.forced_bus_off = False
        self._waiting: deque[Arrival] = deque()
        self._log_cycle_ms = log_cycle_ms
        self._logged: tuple[object, ...] = ()
        self._stop_ms: int | None = None
        self._random = b""
        self._awaited: str | None = None
        self._refusal = Refusal.NONE

    def run(self, seconds: float | None) -> None:
        """Until `seconds` of the device's time have gone by, or a signal or `quit` arrives."""
        start_ns = time.monotonic_ns()
        last_tick = None if seconds is None else round(seconds * 1000)
        self._write({"start_ns": start_ns})
        while not self.stopping:
            now_ns = time.monotonic_ns()
            self._waiting.extend(self.bus.read(now_ns))
            self._obey()
            due = (now_ns - start_ns) // _TICK_NS
            ended = last_tick is not None and due >= last_tick
            self._catch_up(due if last_tick is None else min(due, last_tick), start_ns)
            self._announce()
            self.stopping |= ended
            rest_ns = start_ns + self.device.ticks * _TICK_NS + _WAKE_NS - time.monotonic_ns()
            if rest_ns > 0:
                time.sleep(rest_ns * 1e-9)
        self.bus.read(time.monotonic_ns())  # what has arrived by now was not lost, and is counted

    def _catch_up(self, due: int, start_ns: int) -> None:
        behind = due - self.device.ticks
        self.most_behind = max(self.most_behind, behind)
        stalled = behind - 1 if behind >= _STALL_TICKS else 0
        # On a computer too slow for 1 kHz there is always more to catch up: a signal must not wait for that.
        while self.device.ticks < due and not self.stopping:
            ends_ns = start_ns + (self.device.ticks + 1) * _TICK_NS
            frames = []
            while self._waiting and self._waiting[0].arrived_ns <= ends_ns:
                frames.append(self._waiting.popleft().frame)
            self.device.bus_off = self.forced_bus_off or self.bus.bus_off
            outgoing = self.device.tick(tuple(frames), self._nonce(), stalled, self.bus.dropped)
            stalled = 0
            if self._stop_ms is None and any(frame.can_id == STOP for frame in frames):
                self._stop_ms = self.device.state.last_tick_ms
            if due - self.device.ticks > _STALE_TICKS:
                self.bus.dropped += len(outgoing)
            else:
                for can_id, data in outgoing:
                    self.bus.send(can_id, data, ends_ns)
            self._log_tick(ends_ns)

    def _announce(self) -> None:
        """Say why a handshake came to nothing, and what a latch or a stop waits for, when that changes."""
        state = self.device.state
        if state.refusal != self._refusal:
            self._refusal = state.refusal
            say(f"handshake refused: {_REFUSED[state.refusal]}" if state.refusal else "handshake accepted")
        waits_for = awaited(state, state.last_tick_ms)
        if waits_for == self._awaited:
            return
        self._awaited = waits_for
        if waits_for is None:
            say(f"cleared: {wire_name(state.state)}")
        else:
            say(f"{wire_name(state.state)} ({wire_name(state.reason)}): waits for {waits_for}")

    def _nonce(self) -> int:
        """32 unpredictable bits; asked of the system in blocks, since every tick takes some and few use them."""
        if not self._random:
            self._random = secrets.token_bytes(4096)
        word, self._random = self._random[:4], self._random[4:]
        return int.from_bytes(word, "big")

    def _log_tick(self, ends_ns: int) -> None:
        """A line for every change, every command taken as ACT or HOLD among them, and one every cycle."""
        if self.log is None:
            return
        state = self.device.state
        command = (state.command_live, state.command_is_hold, state.command_ms)
        mark = (state.state, state.reason, state.armed, state.torque.assist_unm == 0, command, self._stop_ms)
        if mark != self._logged or self.device.ticks % self._log_cycle_ms == 0:
            self._logged = mark
            seen = {"ends_ns": ends_ns, "accepted_live": state.command_live, "stop_ms": self._stop_ms}
            self._write({**self.device.record(), **seen})

    def _write(self, record: dict[str, object]) -> None:
        if self.log is not None:
            self.log.write(json.dumps(record) + "\n")

    def _obey(self) -> None:
        """Commands typed on standard input: the local action, and faults of the simulated world."""
        while self.commands:
            words = self.commands.popleft().split()
            try:
                self._obey_one(words)
                self._write({"command": " ".join(words), "ends_ns": time.monotonic_ns()})
            except (IndexError, ValueError):
                say(f"command {' '.join(words)!r} not understood; {_COMMANDS}", wrong=True)

    def _obey_one(self, words: list[str]) -> None:
        match words[0]:
            case "clear":
                self._confirm()
            case "overrun":
                self.device.skip(int(words[1]) if len(words) > 1 else 10)
            case "stuck" | "gain" | "lag" | "bias" | "mend" | "encoder" | "push":
                if isinstance(self.device, RemoteDevice):
                    raise ValueError("arm and motor are the plant's")
                _break(self.device, words)
            case "busoff":
                self.forced_bus_off = True
            case "buson":
                self.forced_bus_off = False
            case "restart":
                self._start_anew(self._key)
            case "wrongkey":
                self._start_anew(WRONG)
            case "quit":
                self.stopping = True
            case _:
                raise ValueError(words[0])

    def _confirm(self) -> None:
        """The hand at the device. One that comes too early is not kept, and told so: it may mean another latch."""
        waits_for = awaited(self.device.state, self.device.state.last_tick_ms)
        if waits_for is None:
            say("clear refused: nothing is latched")
        elif waits_for != HAND:
            say(f"clear refused: too early, waits for {waits_for}; confirm again after that")
        self.device.local_clear = True

    def _start_anew(self, key: bytes) -> None:
        self.device.start_anew(key, self._nonce())

    def summary(self) -> dict[str, object]:
        """What happened, for the last line."""
        state = self.device.state
        rejected = {why.name.lower(): state.counters[why] for why in Reject if why and state.counters[why]}
        return {
            "seconds": self.device.ticks / 1000,
            "state": wire_name(state.state),
            "reason": wire_name(state.reason),
            "received": self.bus.received,
            "sent": self.bus.sent,
            "send_dropped": self.bus.dropped,
            "link_errors": self.bus.link_errors,
            "rejected": rejected,
            "trips": state.counters[COUNT_TRIPS],
            "lost_frames": state.counters[COUNT_LOST],
            "stall_ticks": state.counters[COUNT_STALL_TICKS],
            "most_behind_ms": self.most_behind,
            "peak_assist_nm": round(self.device.peak_assist_unm * 1e-6, 3),
        }


def _break(device: Device, words: list[str]) -> None:
    """A fault of arm, motor or encoder; those that are there already stay until `mend`."""
    match words[0]:
        case "stuck":
            device.actuator = replace(device.actuator, stuck=True)
        case "gain":
            device.actuator = replace(device.actuator, gain=float(words[1]))
        case "lag":
            device.actuator = replace(device.actuator, lag_s=float(words[1]) / 1000)
        case "bias":
            device.actuator = replace(device.actuator, bias_nm=float(words[1]))
        case "encoder":
            device.encoder_offset_mdeg = int(words[1])
        case "push":
            device.wearer_extra_nm = float(words[1])
        case _:
            device.break_motor()


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """One line, as every other refusal."""
        self.exit(2, f"firmware-sim: {' '.join(message.split())}; firmware-sim --help lists what there is\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="firmware-sim",
        description="Simulated assistive controller with an arm and an actuator on a CAN bus.",
        epilog=f"Commands, a line each, from a pipe or with --interactive: {_COMMANDS}. SIGUSR1 is the local action too.",
    )
    parser.add_argument("--version", action="version", version=f"firmware-sim {version('hilbridge')}")
    parser.add_argument("--bus", default="auto", help="auto, vcan0, can0, hilsim:NAME or interface:channel")
    parser.add_argument("--key-file", type=Path, help="shared key, 32 hex digits, mode 0600 (default: the demo key)")
    parser.add_argument("--controller", choices=CONTROLLERS, default="python", help="the reference, or the same in C")
    parser.add_argument("--profiles", type=Path, help="assist profiles, tighter than those that ship (profiles.toml)")
    parser.add_argument("--seconds", type=_seconds, help="stop after so many seconds of the device's time")
    parser.add_argument("--json-log", type=Path, help="JSON lines: every change, and one every --log-ms")
    parser.add_argument(
        "--log-ms", type=int, default=LOG_CYCLE_MS, choices=range(1, 1001), metavar="MS", help="1 to 1000 (20)"
    )
    parser.add_argument("--wearer-torque", choices=WEARERS, default="reach", help="what the wearer's arm does")
    parser.add_argument("--plant-bus", help="arm and motor are on this bus (`hilbridge plant`), not simulated within")
    parser.add_argument(
        "--interactive", action="store_true", help="read commands from the terminal, while in its foreground"
    )
    parser.add_argument(
        "--until-input-ends", action="store_true", help="end with the pipe of commands, and so with whoever holds it"
    )
    return parser


def _seconds(text: str) -> float:
    seconds = float(text)
    if not 0 < seconds < 1e9:  # also no NaN
        raise argparse.ArgumentTypeError(f"{text}: give seconds above 0")
    return seconds


def main(arguments: list[str] | None = None) -> int:
    """Run the device; 0 after a clean end, 2 with one line where it cannot start, 1 for a defect of its own."""
    options = _parser().parse_args(arguments)
    log: IO[str] | None = None
    bus: Attachment | None = None
    plant: Attachment | None = None
    try:
        spec = parse_spec(options.bus)
        key = load_key(options.key_file, physical=spec.physical)
        if options.json_log is not None:
            log = options.json_log.open("w", encoding="utf-8", buffering=1)
        bus = Attachment(spec)
        use_realtime_scheduling()
        state = power_on(options.controller, key, secrets.randbits(32), profiles=read_own(options.profiles))
        plant = None if options.plant_bus is None else attach(options.plant_bus)
        device = Device(state, options.wearer_torque) if plant is None else LinkedDevice(state, plant)
        node = Node(device, bus, log, options.log_ms)
        _on_signals(node)
        say(f"ready on {spec.interface}:{spec.channel}, profiles {state.profiles.hash32:08X}")
        _take_commands(node, options)
        node.run(options.seconds)
        say(f"done {json.dumps(node.summary())}")
    except (BusUnusable, ControllerUnusable, KeyUnusable, ProfilesUnusable) as error:
        say(" ".join(str(error).split()), wrong=True)
        return 2
    except OSError as error:
        if options.json_log is None:
            return report_defect(error)
        say(f"{options.json_log}: log cannot be written ({error.strerror}); what it holds so far is kept", wrong=True)
        return 2
    except Exception as error:
        return report_defect(error)
    finally:
        for one in (bus, plant):
            if one is not None:
                one.close()
        if log is not None:
            with contextlib.suppress(OSError):  # a full disk has been told of
                log.close()
    return 0


def _take_commands(node: Node, options: argparse.Namespace) -> None:
    def ended() -> None:
        node.stopping |= bool(options.until_input_ends)

    read_terminal_politely()
    threading.Thread(
        target=listen,
        args=(sys.stdin, node.commands.append),
        kwargs={"interactive": options.interactive, "ended": ended},
        daemon=True,
    ).start()


def _on_signals(node: Node) -> None:
    def stop(_signal: int, _frame: FrameType | None) -> None:
        node.stopping = True

    def clear(_signal: int, _frame: FrameType | None) -> None:
        node.commands.append("clear")

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    if hasattr(signal, "SIGUSR1"):
        signal.signal(signal.SIGUSR1, clear)


if __name__ == "__main__":
    sys.exit(main())
