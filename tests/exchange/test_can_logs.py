"""Recordings as logs of other programs and back: equal frames, stamps to the microsecond, and what is lost is said."""

from __future__ import annotations

import json
import random
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import pytest

from hilbridge import cli
from hilbridge.bus.model.frames import DLC_LENGTHS
from hilbridge.errors import InputError
from hilbridge.exchange.can_logs import LOG_SUFFIXES, export_log, import_rows, rows_of_log
from hilbridge.exchange.tables import export_table, rows_of_table
from hilbridge.observe.reading import read_recording
from hilbridge.observe.recording import Recording
from hilbridge.records import Action, HoldReason
from hilbridge.rows import CanRow, CountersRow, Direction, MetaRow, TickRow

START_NS = 1_700_000_000_123_457_000
COUNT = 3_000


def frames(count: int, seed: int = 1, *, errors: bool = True) -> Iterator[CanRow]:
    """Frames of every kind: classical, FD, remote, error, base and extended, sent and received, on two buses."""
    rng, at_ns = random.Random(seed), START_NS
    error: dict[str, Any] = {"direction": Direction.RX, "is_extended": False, "can_id": 0x204}
    for _ in range(count):
        at_ns += rng.choice((0, 1_000, 130_000, 999_999_000))
        way = rng.choice(list(Direction))
        extended, kind = rng.random() < 0.4, rng.randrange(10)
        can_id = rng.getrandbits(29) | 1 << 11 if extended else rng.getrandbits(11)
        common: dict[str, Any] = {
            "direction": way,
            "can_id": can_id,
            "received_ns": at_ns if way is Direction.RX else 0,
            "wall_ns": at_ns,
            "is_extended": extended,
            "channel": rng.choice(("can0", "can1")),
        }
        if kind == 0:
            yield CanRow(at_ns, data=b"", is_remote=True, asked_length=rng.randrange(9), **common)
        elif kind == 1 and errors:
            yield CanRow(at_ns, data=rng.randbytes(8), is_error=True, **{**common, **error, "received_ns": at_ns})
        elif kind < 5:
            data = rng.randbytes(rng.choice(DLC_LENGTHS))
            flags = {"switches_rate": rng.random() < 0.5, "sender_passive": rng.random() < 0.3}
            yield CanRow(at_ns, data=data, is_fd=True, **flags, **common)
        else:
            yield CanRow(at_ns, data=rng.randbytes(rng.randrange(9)), **common)


def recorded(path: Path, rows: Iterator[CanRow]) -> list[CanRow]:
    """A recording of these rows; gives them, too."""
    kept = list(rows)
    with Recording(path) as recording:
        recording.write(MetaRow(START_NS, wall_minus_monotonic_ns=0))
        for row in kept:
            recording.write(row)
    return kept


def round_trip(folder: Path, form: str, rows: Iterator[CanRow]) -> tuple[list[CanRow], list[CanRow], dict[str, int]]:
    """The frames before and after recording -> log -> recording, and what was said to be lost."""
    before = recorded(folder / "before.mcap", rows)
    log = folder / f"log{LOG_SUFFIXES[form]}"
    made = export_log(folder / "before.mcap", log)
    import_rows(rows_of_log(log), log, folder / "after.mcap")
    return before, [row for row in read_recording(folder / "after.mcap") if isinstance(row, CanRow)], made.lost


@pytest.mark.parametrize("form", LOG_SUFFIXES)
def test_frames_come_back_equal_with_their_stamps(tmp_path: Path, form: str) -> None:
    before, after, lost = round_trip(tmp_path, form, frames(COUNT))
    errors = sum(row.is_error for row in before)
    if form == "trc":
        assert lost == {"error frames": errors}
        before = [row for row in before if not row.is_error]
    elif form == "asc":
        assert lost == {"error frames' classes and data": errors}
        assert [row.time_ns for row in after if row.is_error] == [row.time_ns for row in before if row.is_error]
        before, after = ([row for row in rows if not row.is_error] for rows in (before, after))
    else:
        assert lost == {}
    key = lambda row: (row.time_ns, row.can_id, row.data)  # noqa: E731 - MF4 keeps each kind by itself
    assert sorted(after, key=key) == sorted(before, key=key)
    if form != "mf4":
        assert after == before


@pytest.mark.parametrize("name", ["csv", "parquet"])
def test_tables_hold_everything_of_a_topic_and_come_back(tmp_path: Path, name: str) -> None:
    before = recorded(tmp_path / "before.mcap", frames(COUNT))
    table = tmp_path / f"frames.{name}"
    assert export_table(tmp_path / "before.mcap", table).rows == COUNT
    import_rows(rows_of_table(table), table, tmp_path / "after.mcap")
    assert [row for row in read_recording(tmp_path / "after.mcap") if isinstance(row, CanRow)] == before
    with Recording(tmp_path / "ticks.mcap") as recording:
        recording.write(MetaRow(5, wall_minus_monotonic_ns=100))
        recording.write(TickRow(7, Action.HOLD, HoldReason.NONE, 0.5))
        recording.write(CountersRow(8, {"port.sent": 3}))
    export_table(tmp_path / "ticks.mcap", tmp_path / f"ticks.{name}", "/tick")
    if name == "csv":
        head, line = (tmp_path / "ticks.csv").read_text().splitlines()
        assert head.startswith("time_ns,unix_ns,action,reason,confidence,")
        assert line.startswith("7,107,HOLD,none,0.5,")
        export_table(tmp_path / "ticks.mcap", tmp_path / "counters.csv", "/counters")
        assert (tmp_path / "counters.csv").read_text().splitlines()[1] == '8,108,"{""port.sent"": 3}"'
    with pytest.raises(InputError, match=r"--topic /none: no such topic; there are .*/can,"):
        export_table(tmp_path / "ticks.mcap", tmp_path / f"none.{name}", "/none")


def test_frames_are_written_in_the_order_in_which_they_were_on_the_bus(tmp_path: Path) -> None:
    wall_ns, offset_ns = START_NS, START_NS - 1_000_000_000
    with Recording(tmp_path / "run.mcap") as recording:
        recording.write(MetaRow(900_000_000, wall_minus_monotonic_ns=offset_ns))
        recording.write(CanRow(1_030_000_000, Direction.TX, 0x60, b"2", result="sent"))
        recording.write(
            CanRow(1_040_000_000, Direction.RX, 0xA0, b"1", received_ns=1_001_000_000, wall_ns=wall_ns + 1_000)
        )
        recording.write(CanRow(1_050_000_000, Direction.RX, 0xA1, b"3", received_ns=1_035_000_000))
    export_log(tmp_path / "run.mcap", tmp_path / "run.log")
    assert (tmp_path / "run.log").read_text().splitlines() == [
        "(1700000000.123458) can0 0A0#31 R",
        "(1700000000.153457) can0 060#32 T",
        "(1700000000.158457) can0 0A1#33 R",
    ]


def test_other_programs_read_what_we_write(tmp_path: Path) -> None:
    before = recorded(tmp_path / "run.mcap", frames(300, errors=False))
    for form, suffix in LOG_SUFFIXES.items():
        export_log(tmp_path / "run.mcap", tmp_path / f"run{suffix}")
        if form not in ("mf4", "candump"):  # python-can's candump has no remote lengths, its MF4 is tested below
            with can.LogReader(tmp_path / f"run{suffix}") as reader:
                assert sum(1 for _ in reader) == len(before)
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(tmp_path / "run.mf4") as file:
        seen = file.get("CAN_DataFrame.ID", group=0).samples
    assert sorted(seen) == sorted(row.can_id for row in before if not row.is_remote)


@pytest.mark.skipif(shutil.which("log2asc") is None, reason="can-utils are not installed")
def test_can_utils_read_what_we_write(tmp_path: Path) -> None:
    before = recorded(tmp_path / "run.mcap", (row for row in frames(300, errors=False) if not row.is_fd))
    export_log(tmp_path / "run.mcap", tmp_path / "run.log")
    command = ["log2asc", "-I", "run.log", "-O", "run.asc", "can0", "can1"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    assert len([row for row in rows_of_log(tmp_path / "run.asc") if not row.is_error]) == len(before)


def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """What the command line says when it ends with 2: one line."""
    monkeypatch.setattr("sys.argv", ["hilbridge", *words])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    said = capsys.readouterr().err.strip()
    assert "\n" not in said
    return said


def test_the_command_line_refuses_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(tmp_path / "run.mcap", frames(10))
    (tmp_path / "zero.blf").write_bytes(b"")
    (tmp_path / "zip.mcap").write_bytes(b"PK\x03\x04" + bytes(60))
    (tmp_path / "text.csv").write_text("a,b\n1,2\n")
    (tmp_path / "noise.parquet").write_bytes(bytes(range(256)))
    (tmp_path / "late.log").write_text("(99999999999999.0) can0 123#00\n")
    (tmp_path / "empty.log").write_text("")
    run, out = str(tmp_path / "run.mcap"), str(tmp_path / "out.mcap")
    for words, says in (
        (["export", run, "--to", "xls"], "no such format; there are blf"),
        (["export", run, "--to", "blf", "--out", f"{run}.asc"], "something.blf"),
        (["export", run, "--to", "blf", "--topic", "/tick"], "use --to csv"),
        (["export", str(tmp_path / "none.mcap"), "--to", "blf"], "no such file"),
        (["export", str(tmp_path / "zip.mcap"), "--to", "asc"], "no MCAP file"),
        (["export", str(tmp_path / "zip.mcap"), "--to", "csv"], "no MCAP file"),
        (["import", str(tmp_path / "zero.blf"), out], "cannot be read"),
        (["import", str(tmp_path / "text.csv"), out], "no column 'time_ns'"),
        (["import", str(tmp_path / "noise.parquet"), out], "Parquet"),
        (["import", str(tmp_path / "late.log"), out], "impossible time"),
        (["import", str(tmp_path / "empty.log"), out], "no CAN frame"),
        (["import", str(tmp_path / "none.trc"), out], "no such file"),
        (["import", run, out], "not a CAN log by its name"),
        (["import", str(tmp_path / "late.log"), str(tmp_path / "out.txt")], "something.mcap"),
        (["import", str(tmp_path / "late.log"), run], "is there already"),
        (["play", str(tmp_path / "zip.mcap"), "--bus", "hilsim:none"], "no MCAP file"),
        (["play", run, "--bus", "hilsim:none", "--speed", "0"], "--speed"),
    ):
        assert says in refused(monkeypatch, capsys, *words), words
    assert not (tmp_path / "out.mcap").exists()
    assert not (tmp_path / "zip.csv").exists()


def test_what_is_lost_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = recorded(tmp_path / "run.mcap", frames(200))
    for words in (["--json"], []):
        monkeypatch.setattr(
            "sys.argv", ["hilbridge", "export", str(tmp_path / "run.mcap"), "--to", "trc", "--force", *words]
        )
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == 0
        said = capsys.readouterr().out
        errors = sum(row.is_error for row in before)
        if words:
            assert json.loads(said)["lost"] == {"error frames": errors}
        else:
            assert f"lost: {errors} error frames" in said
