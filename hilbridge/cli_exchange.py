"""Commands between recordings and other programs: export, import, play."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from hilbridge.errors import InputError

_TABLES = ("csv", "parquet")
Json = Annotated[bool, typer.Option("--json", help="print one JSON object instead of text")]
Force = Annotated[bool, typer.Option("--force", help="replace a file that is there already")]


def register(app: typer.Typer) -> None:
    """Add them to the command line."""
    app.command("export")(export)
    app.command("import")(import_log)
    app.command("play")(play)
    app.command("export-onnx")(export_onnx)


def export(
    recording: Annotated[Path, typer.Argument(help="a recording (.mcap)")],
    to: Annotated[str, typer.Option("--to", help="blf, asc, mf4, candump, trc, csv or parquet")],
    out: Annotated[Path | None, typer.Option(help="the file to write; default: beside the recording")] = None,
    topic: Annotated[str, typer.Option(help="with csv and parquet: which topic")] = "/can",
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a recording's CAN frames as a log of another program, or one topic as a table."""
    from hilbridge.exchange.can_logs import LOG_SUFFIXES, export_log
    from hilbridge.exchange.tables import export_table
    from hilbridge.terminal import counted

    suffix = LOG_SUFFIXES.get(to, f".{to}" if to in _TABLES else None)
    if suffix is None:
        raise InputError(f"--to {to}: no such format; there are {', '.join([*LOG_SUFFIXES, *_TABLES])}")
    if topic != "/can" and to not in _TABLES:
        raise InputError(f"--topic {topic}: {to} holds CAN frames only; use --to csv or --to parquet")
    target = out or recording.with_suffix(suffix)
    if target.suffix.lower() != suffix:
        raise InputError(f"--out {target}: a {to} file is called something{suffix}")
    _refuse_replacing(target, recording, force=force)
    with counted("exporting", quiet=as_json) as progress:
        table = to in _TABLES
        made = export_table(recording, target, topic, progress) if table else export_log(recording, target, progress)
    _tell(made, as_json=as_json)


def export_onnx(
    bundle: Annotated[Path | None, typer.Argument(help="model bundle; default: the one that ships")] = None,
    out: Annotated[Path, typer.Option(help="the file to write")] = Path("out/bundle.onnx"),
    force: Force = False,
) -> None:
    """Write a bundle's network as ONNX: raw features of one window in, logits out (extra `onnx`)."""
    from hilbridge.exchange.onnx_model import export_onnx as write
    from hilbridge.intent.bundle import demo_bundle_path, load_bundle

    source = bundle or demo_bundle_path()
    loaded = load_bundle(source)
    _refuse_replacing(out, source, force=force)
    typer.echo(f"network of bundle {loaded.bundle_id:#06x}: {write(loaded, out)}")


def import_log(
    log: Annotated[Path, typer.Argument(help=".blf, .asc, .mf4, .log (candump), .trc, or an exported .csv, .parquet")],
    out: Annotated[Path, typer.Argument(help="the recording to write (.mcap)")],
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Make a recording of a CAN log."""
    from hilbridge.exchange.can_logs import import_rows, rows_of_log
    from hilbridge.exchange.tables import rows_of_table
    from hilbridge.terminal import counted

    if out.suffix.lower() != ".mcap":
        raise InputError(f"{out}: a recording is called something.mcap")
    _refuse_replacing(out, log, force=force)
    rows = rows_of_table(log) if log.suffix.lower().lstrip(".") in _TABLES else rows_of_log(log)
    with counted("importing", quiet=as_json) as progress:
        made = import_rows(rows, log, out, progress)
    _tell(made, as_json=as_json)


def _refuse_replacing(target: Path, source: Path, *, force: bool) -> None:
    if target.exists() and source.exists() and target.samefile(source):
        raise InputError(f"{target}: is what is read; name another file to write")
    if target.exists() and not force:
        raise InputError(f"{target}: is there already; name another file, or replace it with --force")


def _tell(made: Any, *, as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps({**made._asdict(), "path": str(made.path)}))
        return
    typer.echo(f"{made.path}: {made.rows} rows")
    for what, count in made.lost.items():
        typer.echo(f"lost: {count} {what}; the format does not hold them")
    if made.missing is not None:
        typer.echo(f"not whole: {made.missing}")


def play(
    recording: Annotated[Path, typer.Argument(help="a recording (.mcap)")],
    bus: Annotated[str, typer.Option("--bus", help="auto, vcan0, can0, hilsim:NAME, any interface:channel")],
    speed: Annotated[float, typer.Option(help="2: twice as fast; 0.5: at half the speed")] = 1.0,
    only_rx: Annotated[bool, typer.Option("--only-rx", help="only what the bridge received, not what it sent")] = False,
    dbc: Annotated[
        Path | None, typer.Option(help="a site's own DBC: its commands stay off a physical bus, too")
    ] = None,
    as_json: Json = False,
) -> None:
    """Put recorded CAN frames on a bus, on time. Commands to a device never go on a physical one."""
    import asyncio

    from hilbridge.exchange.play import play as play_frames

    played = asyncio.run(play_frames(recording, bus, speed, only_rx=only_rx, dbc=dbc))
    if as_json:
        told = {"sent": played.sent, "withheld": dict(played.withheld), "late": played.late}
        typer.echo(json.dumps({**told, "most_late_ms": round(played.most_late_ms, 3), "missing": played.missing}))
        return
    typer.echo(f"{played.sent} frames played; {played.late} late, by {played.most_late_ms:.1f} ms at most")
    for why, count in played.withheld.items():
        typer.echo(f"not played: {count} frames ({why})")
    if played.missing is not None:
        typer.echo(f"not whole: {played.missing}")
