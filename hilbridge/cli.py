"""The command line: parse, call one room, print. One short function per command; what it prints is for people unless
`--json` asks for one JSON object.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated, Any

import typer

from hilbridge import cli_bus, cli_exchange, cli_learning, cli_record, cli_run, cli_tune
from hilbridge.cli_examples import EXAMPLES
from hilbridge.cli_run import (
    BundleFile,
    Bus,
    BusOption,
    Camera,
    ConfigFile,
    Force,
    Gaze,
    Inertial,
    Json,
    RunFolder,
    Skeleton,
    print_or_json,
)
from hilbridge.cli_shared import Version, open_in_browser, show_examples
from hilbridge.guard import run_guarded

# The predictor's matrices are small: a second BLAS thread only spins on the processor that the device or camera needs.
# It must be said before numpy is imported, which every command does itself.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

app = typer.Typer(
    name="hilbridge",
    help="Hardware-in-loop CAN bridge for assistive devices: predicts, decides Act or Hold, speaks CAN.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _print_json(value: Any) -> None:
    typer.echo(json.dumps(value, sort_keys=True, allow_nan=False))


@app.callback()
def _every_command(version: Version = False) -> None:
    """What stands before the command's name."""


@app.command()
def demo(
    seconds: Annotated[float, typer.Option(min=3.0, help="how long")] = 30.0,
    out: RunFolder = None,
    force: Force = False,
    bus: Annotated[str, typer.Option("--bus", help="auto, vcan0, or any python-can interface:channel")] = "auto",
    seed: Annotated[int, typer.Option(min=0, help="which simulated person and session")] = 3,
    tremor_hz: Annotated[float, typer.Option(min=0.0, max=15.0, help="give the wearer a tremor of so many Hz")] = 0.0,
    bundle: BundleFile = None,
    open_page: Annotated[
        bool,
        typer.Option("--open", help="open the live page (extra `monitor`) in a browser, and the report at the end"),
    ] = False,
    as_json: Json = False,
) -> None:
    """Run the main job: a simulated wearer, the bridge, CAN, and a simulated device in another process."""
    from hilbridge.demo import DemoOptions, run_demo
    from hilbridge.run import run_folder
    from hilbridge.terminal import live_line

    with run_folder("demo", out, force=force) as folder, live_line(seconds, quiet=as_json) as progress:
        outcome = run_demo(DemoOptions(seconds, folder, bus, seed, tremor_hz, bundle, open_page), progress)
    print_or_json(outcome, as_json)
    if open_page:
        open_in_browser(outcome.report.resolve().as_uri())


@app.command()
def doctor(
    bus: Bus = None,
    bus_option: BusOption = None,
    camera: Camera = None,
    gaze: Gaze = None,
    inertial: Inertial = None,
    skeleton: Skeleton = None,
    bundle: BundleFile = None,
    config: ConfigFile = None,
    as_json: Json = False,
) -> None:
    """Say what is well, what is not, and the command that mends it. Exit code 1 where something needed is ill."""
    from hilbridge.config import load_config, parse_options
    from hilbridge.doctor import Verdict, examine, worst
    from hilbridge.terminal import print_findings

    given: dict[str, dict[str, object]] = {
        "sensors": {"camera": camera, "gaze": gaze, "inertial": inertial, "skeleton": skeleton},
        "bus": {"spec": bus, "options": parse_options(bus_option) if bus_option else None},
        "model": {"bundle": None if bundle is None else str(bundle)},
    }
    settings = load_config(config, given)
    findings = examine(settings, look_at_bus=bus is not None or config is not None)
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
cli_exchange.register(app)
cli_learning.register(app)
cli_record.register(app)
cli_run.register(app)
cli_tune.register(app)
show_examples(app, EXAMPLES)


def main() -> None:
    """Entry point: every way out is one line and an exit code (`hilbridge.guard`)."""
    run_guarded(app, "hilbridge")


if __name__ == "__main__":
    main()
