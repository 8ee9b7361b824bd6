"""The commands of the method on data: train, certify, evaluate, data describe, data pack."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from hilbridge.errors import InputError, needs_extra

Json = Annotated[bool, typer.Option("--json", help="print one JSON object instead of text")]
Data = Annotated[
    list[Path] | None,
    typer.Option(
        "--data", help="labelled recordings, folders of them, feature packs, or an EGTEA Gaze+ folder; many times"
    ),
]
Jobs = Annotated[int, typer.Option(help="processes at once, by fold or by person; -1: all cores")]
Cluster = Annotated[
    str | None, typer.Option(help="ray, ray://HOST:PORT, dask or dask://HOST:PORT in place of local processes")
]
BundleFile = Annotated[Path | None, typer.Option("--bundle", help="model bundle; default: the one that ships")]


def register(app: typer.Typer) -> None:
    """Add them to the command line."""
    app.command()(train)
    app.command()(evaluate)
    app.command()(certify)
    app.command()(adapt)
    app.command()(card)
    data = typer.Typer(help="Look at data sets.", no_args_is_help=True)
    data.command("describe")(data_describe)
    data.command("pack")(data_pack)
    data.command("simulate")(data_simulate)
    app.add_typer(data, name="data")


def train(
    data: Data = None,
    out: Annotated[Path, typer.Option(help="the bundle to write")] = Path("out/bundle.safetensors"),
    work: Annotated[Path, typer.Option(help="checkpoints, logs, folds, recorded streams")] = Path("out/train"),
    recipe: Annotated[str, typer.Option(help="with --data: best, or paper")] = "best",
    folds: Annotated[int, typer.Option(min=2, help="with --data: at most so many, by person")] = 5,
    jobs: Jobs = 1,
    cluster: Cluster = None,
    report: Annotated[
        Path | None, typer.Option(help="with --data: folder of report and card; default: by --out")
    ] = None,
    wearer: Annotated[str, typer.Option(help="without --data: demo or benchmark")] = "demo",
    people: Annotated[int, typer.Option(min=8, help="without --data: how many simulated people")] = 600,
    seconds: Annotated[float, typer.Option(min=10.0, help="of each")] = 60.0,
    precision: Annotated[
        float | None, typer.Option(min=0.0, max=1.0, help="tau_on must replay to it; default: 0.9, with --data 0.8")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="of everything that is random")] = 0,
) -> None:
    """Train on recorded people (--data) or simulated ones, calibrate, choose thresholds; write one bundle.

    An interrupted run goes on where it was.
    """
    with needs_extra("train"):
        from hilbridge.learning.training import make_bundle
        from hilbridge.learning.training.recipes import DEMO_RECIPE, RECIPES

    if data:
        from hilbridge.people.train import PeopleConfig, train_on_people

        own = replace(RECIPES[recipe], seed=seed) if recipe in RECIPES else None
        folder = report or out.parent / f"{out.stem}-report"
        asked = PeopleConfig(tuple(data), out, work, folder, recipe, own, precision or 0.8, folds, jobs, cluster)
        made = train_on_people(asked, say=lambda line: typer.echo(line, err=True))
        typer.echo("\n".join([*made.lines, f"bundle: {made.bundle}", f"report: {made.report}", f"card: {made.card}"]))
        return
    settings = replace(DEMO_RECIPE, seed=seed)
    wanted = 0.9 if precision is None else precision
    try:
        config = make_bundle.TrainConfig(
            out=out, work=work, wearer=wearer, people=people, seconds=seconds, precision=wanted, recipe=settings
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
    data: Data = None,
    precision: Annotated[float, typer.Option(min=0.0, max=1.0, help="act-only precision to certify")] = 0.8,
    delta: Annotated[float, typer.Option(min=0.0, max=1.0, help="how often the promise may fail")] = 0.05,
    bundle: BundleFile = None,
    method: Annotated[str, typer.Option(help="betting, betting_pooled, cluster_t or clopper_pearson")] = "betting",
    people: Annotated[int, typer.Option(min=2, help="without --data: how many simulated people")] = 200,
    write: Annotated[Path | None, typer.Option(help="write the bundle with the certified tau_on here")] = None,
    jobs: Jobs = 1,
    cluster: Cluster = None,
) -> None:
    """Choose a tau_on that keeps its promise on people it has not seen (--data, or simulated ones).

    Exit code 1, and how much more data it takes, where these people cannot support it.
    """
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
            jobs=jobs,
            cluster=cluster,
        )
        if data:
            from hilbridge.people.certify import certify_on_people

            result = certify_on_people(config, data, lambda line: typer.echo(line, err=True))
        else:
            with counting("simulated people", people) as step:
                result = certifying.certify_bundle(config, progress=step)
    except ValueError as error:
        raise InputError(str(error)) from None
    typer.echo("\n".join(result.lines()))
    if result.certificate.tau_on is None:
        raise typer.Exit(1)


def adapt(
    data: Annotated[list[Path], typer.Option("--data", help="labelled sessions of one wearer; many times")],
    bundle: BundleFile = None,
    out: Annotated[Path, typer.Option(help="the bundle to write")] = Path("out/adapted.safetensors"),
) -> None:
    """Make a bundle more careful for one wearer, from actions whose verb became known; it never loosens a threshold."""
    from hilbridge.intent.bundle import demo_bundle_path

    with needs_extra("train"):
        from hilbridge.people.adapt import adapt as adapting

    made = adapting(bundle or demo_bundle_path(), data, out, lambda line: typer.echo(line, err=True))
    typer.echo("\n".join(made.lines()))


def data_simulate(
    out: Annotated[Path, typer.Argument(help="folder for the recordings")],
    people: Annotated[int, typer.Option(min=1, help="how many")] = 12,
    seconds: Annotated[float, typer.Option(min=10.0, help="of each")] = 60.0,
    wearer: Annotated[str, typer.Option(help="demo, benchmark, demo-hidden or benchmark-hidden")] = "demo",
    seed: Annotated[int, typer.Option(min=0, help="of the first person")] = 30_000,
) -> None:
    """Write simulated people as labelled recordings, to try training on people. Their origin says simulated."""
    from hilbridge.people.simulate import difficulty_named, simulate
    from hilbridge.terminal import counting

    difficulty = difficulty_named(wearer)
    with counting("simulated people", people) as step:
        made = simulate(out, people, seconds, difficulty, seed, step)
    typer.echo(f"{len(made)} labelled recordings under {out}")


def card(
    bundle: Annotated[Path | None, typer.Argument(help="model bundle; default: the one that ships")] = None,
    out: Annotated[Path | None, typer.Option(help="write it here in place of printing it")] = None,
) -> None:
    """Say in words what a bundle was made of, what it reaches, and whether it may act on a physical bus."""
    from hilbridge.files import write_whole
    from hilbridge.intent.bundle import demo_bundle_path, load_bundle
    from hilbridge.intent.card import card_of

    text = card_of(load_bundle(bundle or demo_bundle_path()))
    typer.echo(text.rstrip() if out is None else f"card: {write_whole(out, text)}")


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
    jobs: Annotated[int, typer.Option(help="sessions at once; -1: one a core")] = 1,
    cluster: Cluster = None,
) -> None:
    """Run gaze and videos through the feature chain once and keep feature_packs/SESSION.npz; what is there is kept."""
    from hilbridge.terminal import counting

    with needs_extra("train"):
        from hilbridge.learning.data import packs

    try:
        with counting("sessions", packs.missing(path)) as step:
            say = partial(typer.echo, err=True)
            made = packs.make_packs(path, hands, step, say, jobs=jobs, cluster=cluster)
    except ValueError as error:
        raise InputError(str(error)) from None
    typer.echo(f"{len(made)} packs written under {path / 'feature_packs'}")
