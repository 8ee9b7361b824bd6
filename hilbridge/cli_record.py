"""Commands for recordings: the report again, recover, replay, view."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

Recordings = Annotated[list[Path], typer.Argument(help="a recording (.mcap), a run's folder, or the parts in order")]
Json = Annotated[bool, typer.Option("--json", help="print one JSON object instead of text")]


def register(app: typer.Typer) -> None:
    """Add them to the command line."""
    app.command("recover")(recover)
    app.command("report")(report)
    app.command("replay")(replay)
    app.command("view")(view)


def _print_json(value: Any) -> None:
    typer.echo(json.dumps(value, sort_keys=True, allow_nan=False))


def recover(
    recording: Annotated[Path, typer.Argument(help="a recording that a crash, a kill or a full disk left")],
    out: Annotated[Path | None, typer.Option(help="the whole file (default: NAME.recovered.mcap beside it)")] = None,
) -> None:
    """Make a whole file of a recording that was cut off; the original stays."""
    from hilbridge.observe.recover import recover as make_whole

    made = make_whole(recording, out)
    lacked = f"; {made.missing}" if made.missing else "; it was whole already"
    typer.echo(f"{made.path}: {made.rows} rows{lacked}")


def report(
    recordings: Recordings,
    out: Annotated[Path | None, typer.Option("--out", help="the page; default: beside the recording")] = None,
    as_json: Json = False,
) -> None:
    """Make the report of a recording again, and print its summary."""
    from hilbridge.observe.report import write_report
    from hilbridge.terminal import print_summary

    first = recordings[0]
    target = out or (first / "report.html" if first.is_dir() else first.with_name("report.html"))
    summary = write_report(recordings, target)
    if as_json:
        _print_json({**summary.as_json(), "report": str(target)})
    else:
        print_summary(summary)
        typer.echo(f"report     {target}")


def replay(
    recordings: Recordings,
    start: Annotated[
        str | None, typer.Option("--from", help="features (default), gaze+video, or beliefs: where to start")
    ] = None,
    bundle: Annotated[Path | None, typer.Option("--bundle", help="another model bundle than the recording's")] = None,
    what_if: Annotated[
        list[str] | None, typer.Option("--what-if", help="gate.tau_on=0.7 and the like; may be given again")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="write a page with both traces")] = None,
    as_json: Json = False,
) -> None:
    """Decide a recording anew with today's code, bundle and gate. Exit code 1 where a decision comes out differently."""
    from hilbridge.errors import InputError
    from hilbridge.replay.again import Options
    from hilbridge.replay.again import replay as decide_anew
    from hilbridge.replay.page import Traces, write_page
    from hilbridge.replay.source import Source

    if start is not None and start not in list(Source):
        raise InputError(f"--from {start}: no such start; there are {', '.join(Source)}")
    options = Options(None if start is None else Source(start), bundle, tuple(what_if or ()))
    traces = Traces()
    difference = decide_anew(recordings, options, traces.watch if out is not None else lambda compared: None)
    if out is not None:
        write_page(out, difference, traces)
    if as_json:
        _print_json(difference.as_json())
    else:
        typer.echo(difference.as_text())
        if out is not None:
            typer.echo(f"page       {out}")
    if difference.ticks_differing:
        raise typer.Exit(1)


def view(
    recordings: Recordings,
    save: Annotated[Path | None, typer.Option(help="write a .rrd file instead of opening the viewer")] = None,
) -> None:
    """Open a recording in Rerun (extra `view`): camera, gaze, confidence against thresholds, gate, device, torque."""
    from hilbridge.observe.view import show

    show(recordings, save)
