"""One topic of a recording as a table, CSV or Parquet, and a table of CAN frames back into rows.

A column a field, `time_ns` first and `unix_ns` beside it; what is no plain value stands as JSON.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hilbridge.errors import InputError, needs_extra
from hilbridge.exchange.can_logs import Exchanged, Progress
from hilbridge.files import in_place_of
from hilbridge.observe.reading import read_recording
from hilbridge.rows import TOPICS, CanRow, MetaRow, encode, from_fields, json_schema

_BATCH = 20_000
_PLAIN = {"integer": int, "number": float, "boolean": bool, "string": str}
Cells = dict[str, Any]
Write = Callable[[Cells], object]


def export_table(recording: Path, target: Path, topic: str = "/can", progress: Progress = lambda: None) -> Exchanged:
    """Write the rows of a topic as `.csv` or `.parquet`, by the target's name. Raises InputError."""
    if topic not in TOPICS:
        raise InputError(f"--topic {topic}: no such topic; there are {', '.join(sorted(TOPICS))}")
    kinds = {name: _PLAIN.get(part.get("type", ""), str) for name, part in json_schema(topic)["properties"].items()}
    columns: dict[str, type] = {"time_ns": int, "unix_ns": int, **kinds}
    reader = read_recording(recording, (topic, MetaRow.topic))
    offset_ns, count = 0, 0
    open_table = _parquet if target.suffix.lower() == ".parquet" else _csv
    with in_place_of(target) as part, open_table(part, columns) as write:
        for row in reader:
            if isinstance(row, MetaRow):
                offset_ns = row.wall_minus_monotonic_ns or 0
            if row.topic != topic:
                continue
            cells = {name: _cell(value) for name, value in json.loads(encode(row)).items()}
            write({"time_ns": row.time_ns, "unix_ns": row.time_ns + offset_ns, **cells})
            count += 1
            progress()
    return Exchanged(target, count, {}, reader.missing)


def _cell(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list | dict) else value


@contextmanager
def _csv(path: Path, columns: dict[str, type]) -> Iterator[Write]:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(columns))
        writer.writeheader()
        yield writer.writerow


@contextmanager
def _parquet(path: Path, columns: dict[str, type]) -> Iterator[Write]:
    with needs_extra("export"):
        import pyarrow
        import pyarrow.parquet
    types = {int: pyarrow.int64(), float: pyarrow.float64(), bool: pyarrow.bool_()}
    schema = pyarrow.schema([(name, types.get(kind, pyarrow.string())) for name, kind in columns.items()])
    waiting: list[Cells] = []

    def flush() -> None:
        file.write_batch(pyarrow.RecordBatch.from_pylist(waiting, schema))
        waiting.clear()

    def write(cells: Cells) -> None:
        waiting.append(cells)
        if len(waiting) >= _BATCH:
            flush()

    with pyarrow.parquet.ParquetWriter(path, schema) as file:
        yield write
        if waiting:
            flush()


def rows_of_table(table: Path) -> Iterator[CanRow]:
    """The CAN frames of a table that `export_table` wrote. Raises InputError naming the line."""
    if not table.is_file():
        raise InputError(f"{table}: no such file; give the path of a table")
    lines = _parquet_lines(table) if table.suffix.lower() == ".parquet" else _csv_lines(table)
    for number, cells in enumerate(lines, 2):
        try:
            given = {name: value for name, value in cells.items() if value is not None and value != ""}
            time_ns = int(given.pop("time_ns"))
            given.pop("unix_ns", None)
            row = from_fields(CanRow.topic, time_ns, {"data": "", **given})
        except (KeyError, TypeError, ValueError) as error:
            text = f"no column {error}" if isinstance(error, KeyError) else str(error)
            raise InputError(
                f"{table}:{number}: no row of /can ({text}); is it what `hilbridge export` wrote?"
            ) from None
        assert isinstance(row, CanRow)
        yield row


def _csv_lines(table: Path) -> Iterator[Cells]:
    try:
        with table.open(encoding="utf-8-sig", newline="") as file:
            yield from csv.DictReader(file)
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{table}: cannot be read as CSV ({error})") from None


def _parquet_lines(table: Path) -> Iterator[Cells]:
    with needs_extra("export"):
        import pyarrow
        import pyarrow.parquet
    try:
        with pyarrow.parquet.ParquetFile(table) as file:
            for batch in file.iter_batches(_BATCH):
                yield from batch.to_pylist()
    except pyarrow.ArrowException as error:
        raise InputError(f"{table}: cannot be read as Parquet ({str(error).splitlines()[0]})") from None
