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
    app.command("align")(align)
    app.command("label")(label)
    app.command("forget")(forget)


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


def align(
    recording: Annotated[Path, typer.Argument(help="the recording of a run in which it was done")],
    by: Annotated[
        str, typer.Option("--by", help="flash (of light, the eye goes to it) or clap (of the hands)")
    ] = "flash",
    latency_ms: Annotated[float, typer.Option(min=80.0, max=500.0, help="from a flash to the eye's movement")] = 200.0,
    write: Annotated[Path | None, typer.Option(metavar="TOML", help="put the line into this configuration")] = None,
) -> None:
    """Estimate a constant offset between camera and gaze, or camera and inertial sensors, that share no clock."""
    from hilbridge.align.measure import By, measure
    from hilbridge.align.written import write_line
    from hilbridge.errors import InputError, nearest

    if by not in list(By):
        raise InputError(f"--by {by}: {nearest(by, list(By))}")
    line = measure(recording, By(by), latency_ms).line()
    if write is not None:
        write_line(write, line)
    typer.echo(line)


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


def label(
    recording: Annotated[Path, typer.Argument(help="a recording (.mcap) or a run's folder")],
    take: Annotated[
        Path | None, typer.Option("--import", help="labels to put in: our CSV, ELAN .eaf, or BORIS CSV/TSV")
    ] = None,
    give: Annotated[Path | None, typer.Option("--export", help="write the recording's labels as CSV")] = None,
    tier: Annotated[str | None, typer.Option(help="of an .eaf file; default: the only one with annotations")] = None,
    offset_ms: Annotated[
        float | None, typer.Option(help="add to the times of --import; default: the first picture (.eaf, BORIS), or 0")
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="of the page; 0: any that is free")] = 0,
    open_page: Annotated[bool, typer.Option("--open", help="open the page in a browser")] = False,
) -> None:
    """Say what the wearer did when: on a page of this computer, or from ELAN, BORIS or a CSV."""
    from hilbridge.labels.exchange import export_labels, import_labels

    if take is not None:
        kept, count = import_labels(recording, take, tier, offset_ms)
        typer.echo(f"{count} labels in {recording} and {kept}")
    if give is not None:
        typer.echo(f"{export_labels(recording, give)} labels in {give}")
    if take is None and give is None:
        _label_page(recording, port, open_page=open_page)


def _label_page(recording: Path, port: int, *, open_page: bool) -> None:
    from hilbridge.cli_shared import open_in_browser
    from hilbridge.labels.page import LabelServer

    with LabelServer(recording, port) as server:
        typer.echo(f"label at {server.url} (this computer only; Ctrl-C ends)")
        if open_page:
            open_in_browser(server.url)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            typer.echo("ended; what was saved is in the recording")


def forget(
    participant: Annotated[str, typer.Argument(help="the pseudonym, as `run --participant` had it")],
    folder: Annotated[Path, typer.Argument(help="where recordings are kept; folders in it are searched, too")],
    yes: Annotated[bool, typer.Option("--yes", help="do it; without, only say what would go")] = False,
    as_json: Json = False,
) -> None:
    """Remove one person's recordings and what was made of them; say what else has the pseudonym in its name."""
    from hilbridge.observe.forget import carry_out, plan_to_forget

    plan = plan_to_forget(participant, folder)
    failed = carry_out(plan) if yes else []
    if as_json:
        _print_json(
            {
                "removed" if yes else "would_remove": [str(path) for path in plan.files if path not in dict(failed)],
                "not_removed": {str(path): why for path, why in failed},
                "only_named": [str(path) for path in plan.named],
                "unread": {str(path): why for path, why in plan.unread},
            }
        )
    else:
        for path in plan.files:
            typer.echo(f"{'removed' if yes else 'would remove'} {path}")
        for path, why in failed:
            typer.echo(f"NOT removed {path}: {why}")
        for path in plan.named:
            typer.echo(f"look yourself: {path} has {participant} in its name")
        for _, why in plan.unread:
            typer.echo(f"look yourself: {why}")
        if not plan.files:
            typer.echo(f"no recording of {participant} under {folder}")
        elif not yes:
            typer.echo(
                "nothing is removed yet; say --yes to do it. Bundles trained on this person keep what they learned"
            )
    if failed:
        raise typer.Exit(1)
