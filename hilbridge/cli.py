"""The command line: parse, call one room, print. One short function per command; what it prints is for people unless
`--json` asks for one JSON object.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hilbridge import cli_bus, cli_learning, cli_record
from hilbridge.guard import run_guarded

if TYPE_CHECKING:
    from hilbridge.run import Outcome

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

Json = Annotated[bool, typer.Option("--json", help="print one JSON object instead of text")]
Bus = Annotated[str | None, typer.Option("--bus", help="auto, vcan0, can0, or any python-can interface:channel")]
ConfigFile = Annotated[Path | None, typer.Option("--config", help="bridge.toml; the command line wins over it")]
BundleFile = Annotated[Path | None, typer.Option("--bundle", help="model bundle; default: the one that ships")]

RunFolder = Annotated[Path | None, typer.Option(help="folder for what it leaves behind; default: a new one in out/")]
Force = Annotated[bool, typer.Option("--force", help="replace the recording that --out holds already")]


def _print_json(value: Any) -> None:
    typer.echo(json.dumps(value, sort_keys=True, allow_nan=False))


@app.command()
def demo(
    seconds: Annotated[float, typer.Option(min=3.0, help="how long")] = 30.0,
    out: RunFolder = None,
    force: Force = False,
    bus: Annotated[str, typer.Option("--bus", help="auto, vcan0, or any python-can interface:channel")] = "auto",
    seed: Annotated[int, typer.Option(min=0, help="which simulated person and session")] = 3,
    tremor_hz: Annotated[float, typer.Option(min=0.0, max=15.0, help="give the wearer a tremor of so many Hz")] = 0.0,
    as_json: Json = False,
) -> None:
    """Run the main job: a simulated wearer, the bridge, CAN, and a simulated device in another process."""
    from hilbridge.demo import DemoOptions, run_demo
    from hilbridge.run import run_folder
    from hilbridge.terminal import live_line

    with run_folder("demo", out, force=force) as folder, live_line(seconds, quiet=as_json) as progress:
        outcome = run_demo(DemoOptions(seconds, folder, bus, seed, tremor_hz), progress)
    _print_outcome(outcome, as_json)


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
    out: RunFolder = None,
    force: Force = False,
    hands: Annotated[bool | None, typer.Option("--hands/--no-hands", help="find hands with MediaPipe")] = None,
    loop: Annotated[bool | None, typer.Option("--loop", help="start a recording again at its end")] = None,
    key_file: Annotated[Path | None, typer.Option(help="16-byte key as hex, mode 0600")] = None,
    listen_only: Annotated[
        bool | None, typer.Option("--listen-only/--send", help="default: listen only on a physical bus")
    ] = None,
    arm: Annotated[bool | None, typer.Option("--arm", help="may send ACT on a physical bus")] = None,
    video: Annotated[bool | None, typer.Option("--video/--no-video", help="record the pictures; default: yes")] = None,
    rotate_mb: Annotated[float | None, typer.Option(help="next part of the recording after so many megabytes")] = None,
    rotate_minutes: Annotated[float | None, typer.Option(help="... or after so many minutes")] = None,
    retain: Annotated[
        float | None, typer.Option(metavar="DAYS", help="remove recordings beside this run's that are older")
    ] = None,
    clear_latch: Annotated[
        bool, typer.Option("--clear-latch", help="authenticate clearing a latch or STOP; confirm it at the device")
    ] = False,
    as_json: Json = False,
) -> None:
    """Run the bridge on a camera and an eye tracker (live or recorded) until they end or Ctrl-C."""
    import asyncio

    from hilbridge.config import load_config
    from hilbridge.run import RunOptions, run_bridge, run_folder
    from hilbridge.runtime.assemble import read_parts
    from hilbridge.runtime.senses import open_senses
    from hilbridge.terminal import live_line

    settings = load_config(
        config,
        {
            "sensors": {"camera": camera, "camera_fps": camera_fps, "gaze": gaze, "hands": hands, "loop": loop},
            "bus": {"spec": bus, "key_file": _text(key_file), "listen_only": listen_only, "arm": arm},
            "model": {"bundle": _text(bundle)},
            "recording": {
                "video": video,
                "rotate_mb": rotate_mb,
                "rotate_minutes": rotate_minutes,
                "retain_days": retain,
            },
        },
    )
    parts = read_parts(settings)
    senses = open_senses(settings.sensors)
    title = f"run: camera {settings.sensors.camera}, gaze {settings.sensors.gaze}"
    with run_folder("run", out, force=force) as folder, live_line(seconds, quiet=as_json) as progress:
        asked = RunOptions(title, seconds, clear_latch=clear_latch)
        outcome = asyncio.run(run_bridge(settings, parts, senses, folder, asked, progress))
    _print_outcome(outcome, as_json)


def _print_outcome(outcome: Outcome, as_json: bool) -> None:
    from hilbridge.terminal import print_outcome

    try:
        if as_json:
            _print_json(outcome.as_json())
        else:
            print_outcome(outcome)
        sys.stdout.flush()
    except OSError as error:
        error.add_note(f"saved: {outcome.recording}, {outcome.report}")
        raise


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


@app.command("fetch-models")
def fetch_models(
    force: Annotated[bool, typer.Option("--force", help="fetch again what is there")] = False,
) -> None:
    """Obtain the hand model (official file, or assembled from a PyPI wheel), check its hash, store it for the user."""
    from hilbridge.sensors.models import fetch_hand_model, hand_model_path

    fetch_hand_model(hand_model_path(), force=force, say=typer.echo)


@app.command("bus-analysis")
def bus_analysis(
    dbc: Annotated[Path, typer.Argument(help="a DBC file; `hilbridge dbc --out FILE` writes ours")],
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


cli_bus.register(app)
cli_learning.register(app)
cli_record.register(app)


def main() -> None:
    """Entry point: every way out is one line and an exit code (`hilbridge.guard`)."""
    run_guarded(app, "hilbridge")


if __name__ == "__main__":
    main()
