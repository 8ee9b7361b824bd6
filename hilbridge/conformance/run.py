"""`hilbridge conformance`: listen, admit, then go through the plan on a real bus."""

from __future__ import annotations

import asyncio
import random
import secrets
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hilbridge.bus.diagnosis import diagnose, known_messages, observation_of
from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.options import checked_options
from hilbridge.bus.port.spec import parse_spec
from hilbridge.config import Config
from hilbridge.conformance.admission import admit_bus, admit_company
from hilbridge.conformance.bus_line import BusLine
from hilbridge.conformance.cases.case import Case
from hilbridge.conformance.findings import Finding
from hilbridge.conformance.plan import conduct
from hilbridge.conformance.tester import ByHand, Setting
from hilbridge.errors import InputError
from hilbridge.priority import use_realtime_scheduling
from hilbridge.records import Frame
from hilbridge.runtime.assemble import Parts
from hilbridge.wire.keys import load_key
from hilbridge.wire.secoc import Authenticator

_LISTEN_S = 1.5
_PERSON_MS = 60_000.0  # somebody has to walk to the device


@dataclass(frozen=True, slots=True)
class Asked:
    """What a person asked for."""

    cases: Sequence[Case]
    phases: int = 10
    margin_ms: float = 5.0
    clear_command: str | None = None
    on_a_bench: bool = False


def run_conformance(
    config: Config, parts: Parts, asked: Asked, show: Callable[[Finding], None], say: Callable[[str], None]
) -> list[Finding]:
    """Test the device on the configured bus. Raises InputError for a bus, key or device that is not to be tested."""
    options = checked_options(parse_spec(config.bus.spec), config.bus.options)
    press, patience_ms = _hand(asked.clear_command, say)
    physical = asyncio.run(_admit(config, parts, asked, options))
    key = load_key(Path(config.bus.key_file) if config.bus.key_file else None, physical=physical)
    chance = random.Random(secrets.randbits(64))  # a fixed seed would name its nonces beforehand
    setting = Setting(Authenticator(key), chance, asked.margin_ms, asked.phases, press, patience_ms)
    with BusLine(config.bus.spec, options) as line:
        use_realtime_scheduling()
        return conduct(ByHand(line, parts.codec, setting), asked.cases, show)


async def _admit(config: Config, parts: Parts, asked: Asked, options: dict[str, Any]) -> bool:
    """Listen without sending; whether the bus is physical."""
    spec = config.bus.spec
    frames: list[Frame] = []
    async with BusPort.open(spec, listen_only=True, **options) as port:
        made_of = parts.bundle.provenance
        origin = None if made_of is None else made_of.origin
        admit_bus(spec, physical=port.is_physical, on_a_bench=asked.on_a_bench, origin=origin)
        began_s = time.monotonic()
        try:
            async with asyncio.timeout(_LISTEN_S):
                while True:
                    frames.append(await port.receive())
        except TimeoutError:
            seen = observation_of(port, frames, time.monotonic() - began_s)
        findings = diagnose(seen, known_messages(parts.codec.path))
        admit_company(seen, findings, parts.codec, physical=port.is_physical)
        return port.is_physical


def _hand(command: str | None, say: Callable[[str], None]) -> tuple[Callable[[], None] | None, float]:
    """Who confirms at the device: a command, or a person at a terminal who is told; and how long to wait for them."""
    if command is not None:
        words = shlex.split(command)
        if not words:
            raise InputError("--clear-command: is empty; give a command that presses the device's button")
        return lambda: _start(words), Setting._field_defaults["patience_ms"]
    if sys.stdin is not None and sys.stdin.isatty():
        return lambda: say("press the button at the device now, once"), _PERSON_MS
    return None, 0.0


def _start(words: list[str]) -> None:
    try:
        subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    except OSError as error:
        raise InputError(f"--clear-command {words[0]}: {error.strerror}; give a command that can be started") from None
