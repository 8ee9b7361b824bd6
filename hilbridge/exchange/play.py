"""Recorded CAN frames put on a bus again, at the times at which they were there."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.state import SendResult
from hilbridge.errors import InputError
from hilbridge.observe.reading import read_recording
from hilbridge.records import Frame
from hilbridge.rows import CanRow, Direction
from hilbridge.wire.dbc import default_dbc_path
from hilbridge.wire.dbc_file import load_dbc

# What makes a device assist, or begin to. A recording of it has no place where a person may be.
COMMANDS = ("ACT_CMD", "ACT_AUTH", "ARM_REQUEST", "ARM_CHALLENGE", "ARM_RESPONSE")
_FASTEST = 1e6
_LATE_MS = 10.0
_ROOM_S = 0.001


@dataclass(slots=True)
class Played:
    """What became of the frames. `withheld`: why some were not played, and how many."""

    sent: int = 0
    withheld: Counter[str] = field(default_factory=Counter)
    late: int = 0
    most_late_ms: float = 0.0
    missing: str | None = None


def command_ids(dbc: Path | None = None) -> frozenset[int]:
    """Identifiers of commands, by the shipped DBC and by a site's own."""
    paths = {default_dbc_path(), *([dbc] if dbc is not None else [])}
    return frozenset(
        message.frame_id & 0x1FFF_FFFF
        for path in paths
        for message in load_dbc(path).messages
        if message.name in COMMANDS
    )


def withheld(row: CanRow, *, physical: bool, only_rx: bool, commands: frozenset[int]) -> str | None:
    """Why a frame is not played; None where it is. A command in any form stays off a physical bus, also with a fault."""
    if row.is_error:
        return "error frames"
    if physical and row.can_id in commands:
        return "commands, which no recording may give on a physical bus"
    if only_rx and row.direction is Direction.TX:
        return "sent by the bridge"
    return None


def timed(rows: Iterable[CanRow], speed: float) -> Iterator[tuple[int, CanRow]]:
    """Each frame with the time after the first at which it is due, in ns."""
    first_ns: int | None = None
    for row in rows:
        at_ns = row.received_ns or row.time_ns
        first_ns = at_ns if first_ns is None else first_ns
        yield max(0, int((at_ns - first_ns) / speed)), row


async def play(recording: Path, bus: str, speed: float, *, only_rx: bool, dbc: Path | None = None) -> Played:
    """Play a recording's frames. Raises InputError where the recording or the bus cannot be used."""
    if not 0 < speed <= _FASTEST:
        raise InputError(f"--speed {speed}: must be above zero, at most {_FASTEST:g}")
    reader = read_recording(recording, (CanRow.topic,))
    rows = (row for row in reader if isinstance(row, CanRow))
    played = Played()
    commands = command_ids(dbc)
    async with BusPort.open(bus, listen_only=False) as port:
        begin_ns = time.monotonic_ns()
        for due_ns, row in timed(rows, speed):
            why = withheld(row, physical=port.is_physical, only_rx=only_rx, commands=commands)
            if why is not None:
                played.withheld[why] += 1
                continue
            left_s = (begin_ns + due_ns - time.monotonic_ns()) / 1e9
            if left_s > 0:
                await asyncio.sleep(left_s)
            late_ms = max(0.0, -left_s * 1e3)
            played.most_late_ms = max(played.most_late_ms, late_ms)
            played.late += late_ms > _LATE_MS
            await _send(port, row, played)
        played.missing = reader.missing
    if played.sent == 0 and not played.withheld:
        raise InputError(f"recording {recording}: no CAN frame in it")
    return played


async def _send(port: BusPort, row: CanRow, played: Played) -> None:
    """Hand one over; a full queue is waited for, since a later frame must not replace an earlier one."""
    frame = Frame(row.can_id, row.data, is_fd=row.is_fd, is_extended=row.is_extended, is_remote=row.is_remote)
    result = port.send(frame)
    while result is SendResult.QUEUED and port.waiting:
        await asyncio.sleep(_ROOM_S)
    if result in (SendResult.SENT, SendResult.QUEUED):
        played.sent += 1
    else:
        played.withheld[f"not taken by the bus: {result.value}"] += 1
    while port.receive_nowait() is not None:  # nobody reads what others send
        pass
