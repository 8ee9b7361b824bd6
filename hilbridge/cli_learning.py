"""The commands of the method on data: train, certify, evaluate, data describe, data pack."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from hilbridge.errors import InputError, needs_extra

Json = Annotated[bool, typer.Option("--json", help="print one JSON object instead of text")]
BundleFile = Annotated[Path | None, typer.Option("--bundle", help="model bundle; default: the one that ships")]


def register(app: typer.Typer) -> None:
    """Add them to the command line."""
    for command in (train, evaluate, certify):
        app.command()(command)
    data = typer.Typer(help="Look at data sets.", no_args_is_help=True)
    data.command("describe")(data_describe)
    data.command("pack")(data_pack)
    app.add_typer(data, name="data")


def train(
    out: Annotated[Path, typer.Option(help="the bundle to write")] = Path("out/bundle.safetensors"),
    work: Annotated[Path, typer.Option(help="checkpoints, logs, recorded streams")] = Path("out/train"),
    wearer: Annotated[str, typer.Option(help="demo or benchmark")] = "demo",
    people: Annotated[int, typer.Option(min=8, help="how many simulated people")] = 480,
    seconds: Annotated[float, typer.Option(min=10.0, help="of each")] = 60.0,
    precision: Annotated[float, typer.Option(min=0.0, max=1.0, help="act-only precision tau_on must replay to")] = 0.9,
    seed: Annotated[int, typer.Option(min=0, help="of everything that is random")] = 0,
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


def data_describe(path: Annotated[Path, typer.Argument(help="the data set's folder")], as_json: Json = False) -> None:
    """Say what an EGTEA Gaze+ folder holds: annotations, subjects, verbs, gaze files and what is wrong with them."""
    from hilbridge.learning.data.describe import describe

    try:
        summary = describe(path)
    except ValueError as error:
        raise InputError(str(error)) from None
    if as_json:
        typer.echo(json.dumps(summary.as_json()))
    else:
        typer.echo("\n".join(summary.lines()))


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
