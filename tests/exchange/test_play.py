"""hilbridge play: on time, in order, and no command ever on a physical bus."""

from __future__ import annotations

import asyncio
import uuid
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.simulated import SimulatedBackend
from hilbridge.errors import InputError
from hilbridge.exchange.play import COMMANDS, Played, command_ids, play, timed, withheld
from hilbridge.observe.recording import Recording
from hilbridge.records import Frame
from hilbridge.rows import CanRow, Direction, MetaRow

MS = 1_000_000
SENT = [
    CanRow(10 * MS, Direction.TX, 0x060, bytes(8)),
    CanRow(11 * MS, Direction.TX, 0x061, bytes(8)),
    CanRow(12 * MS, Direction.RX, 0x0A0, b"\x01", received_ns=11 * MS),
    CanRow(13 * MS, Direction.RX, 0x204, bytes(8), is_error=True),
    CanRow(14 * MS, Direction.RX, 0x123456, b"\x02" * 12, received_ns=14 * MS, is_extended=True, is_fd=True),
    CanRow(15 * MS, Direction.TX, 0x180, bytes(8)),
    CanRow(40 * MS, Direction.TX, 0x7FF, b""),
]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "run.mcap"
    with Recording(path) as made:
        made.write(MetaRow(0))
        for row in SENT:
            made.write(row)
    return path


def test_the_commands_are_those_of_the_protocol() -> None:
    assert command_ids() == {0x060, 0x061, 0x180, 0x181, 0x182}
    assert len(COMMANDS) == 5


@settings(deadline=None)
@given(
    st.integers(0, 0x1FFF_FFFF) | st.sampled_from(sorted(command_ids())),
    st.sampled_from(Direction),
    st.tuples(*[st.booleans()] * 5),
)
def test_no_command_in_any_form_goes_on_a_physical_bus(
    can_id: int, direction: Direction, flags: tuple[bool, bool, bool, bool, bool]
) -> None:
    error, extended, fd, remote, only_rx = flags
    row = CanRow(0, direction, can_id, b"", is_error=error, is_extended=extended, is_fd=fd, is_remote=remote)
    why = withheld(row, physical=True, only_rx=only_rx, commands=command_ids())
    if can_id in command_ids() or error or (only_rx and direction is Direction.TX):
        assert why is not None
    else:
        assert why is None
    if not error and not only_rx:
        assert withheld(row, physical=False, only_rx=False, commands=command_ids()) is None


def test_frames_are_due_as_they_came_faster_or_slower() -> None:
    rows = [row for row in SENT if not row.is_error]
    assert [due_ns / MS for due_ns, _ in timed(rows, 1.0)] == [0, 1, 1, 4, 5, 30]
    assert [due_ns / MS for due_ns, _ in timed(rows, 0.5)] == [0, 2, 2, 8, 10, 60]


def played_to(name: str, recording: Path, **options: bool) -> tuple[Played, list[Frame]]:
    """Play onto a simulated bus, and what another node of it hears."""

    async def both() -> tuple[Played, list[Frame]]:
        async with BusPort.open(f"hilsim:{name}") as listener:
            played = await play(recording, f"hilsim:{name}", 4.0, only_rx=options.get("only_rx", False))
            heard: list[Frame] = []
            while len(heard) < played.sent:
                heard.append(await asyncio.wait_for(listener.receive(), 20.0))
            return played, heard

    return asyncio.run(both())


def test_everything_but_errors_is_heard_on_a_virtual_bus(recording: Path) -> None:
    played, heard = played_to(f"test-{uuid.uuid4()}", recording)
    expected = [row for row in SENT if not row.is_error]
    assert [(f.can_id, f.data, f.is_extended, f.is_fd) for f in heard] == [
        (row.can_id, row.data, row.is_extended, row.is_fd) for row in expected
    ]
    assert played.withheld == {"error frames": 1}


def test_only_what_the_bridge_received(recording: Path) -> None:
    played, heard = played_to(f"test-{uuid.uuid4()}", recording, only_rx=True)
    assert [frame.can_id for frame in heard] == [0x0A0, 0x123456]
    assert played.withheld == {"error frames": 1, "sent by the bridge": 4}


def test_a_physical_bus_hears_no_command(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SimulatedBackend, "is_physical", True)
    played, heard = played_to(f"test-{uuid.uuid4()}", recording)
    assert [frame.can_id for frame in heard] == [0x0A0, 0x123456, 0x7FF]
    assert sum(count for why, count in played.withheld.items() if "commands" in why) == 3


def test_a_recording_without_frames_and_an_impossible_speed_are_refused(tmp_path: Path, recording: Path) -> None:
    with Recording(tmp_path / "empty.mcap") as made:
        made.write(MetaRow(0))
    bus = f"hilsim:test-{uuid.uuid4()}"
    with pytest.raises(InputError, match="no CAN frame"):
        asyncio.run(play(tmp_path / "empty.mcap", bus, 1.0, only_rx=False))
    for speed in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="--speed"):
            asyncio.run(play(recording, bus, speed, only_rx=False))
