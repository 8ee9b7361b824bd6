"""`hilscenario`: list, run, campaign, minimise, twins, benefit, faults, schema. Parse, call one room, print."""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from hilbridge.cli_shared import Version, show_examples
from hilbridge.errors import InputError
from hilbridge.files import write_whole
from hilbridge.guard import run_guarded

# The predictor's matrices are small; a second BLAS thread only takes the processor from the next scenario.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

app = typer.Typer(
    name="hilscenario",
    help="Script a wearer and faults, run the whole system in virtual time or live, judge what happened.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

EXAMPLES = {
    "benefit": "hilscenario benefit --people 4 --sessions 1 --seconds 30 --jobs 2 --out out/benefit",
    "campaign": "hilscenario campaign catalog/an-ordinary-minute.yaml --samples 20 --out out/campaign",
    "faults": "hilscenario faults",
    "figures": "hilscenario figures",
    "list": "hilscenario list catalog",
    "minimise": "hilscenario minimise failing.yaml --out smaller.yaml",
    "run": "hilscenario run catalog --out out/catalog --jobs 2",
    "schema": "hilscenario schema",
    "twins": "hilscenario twins --tremor cerebellar --seeds 2 --out out/twins",
}
Json = Annotated[bool, typer.Option("--json", help="print one JSON object instead of text")]
Paths = Annotated[list[Path], typer.Argument(help="scenario files, folders of them, or `catalog`, which ships")]
Seed = Annotated[int | None, typer.Option(min=0, help="in place of the scenario's own seed")]


@app.callback()
def _every_command(version: Version = False) -> None:
    """What stands before the command's name."""


@app.command("list")
def list_scenarios(paths: Paths, as_json: Json = False) -> None:
    """List the scenarios, one line each."""
    from hilscenario.format.collect import collect

    found = [(path, scenario) for path, scenario in collect(paths)]
    if as_json:
        rows = [
            {"file": str(path), "name": s.name, "about": s.about, "hazards": s.hazards, "seconds": s.duration / 1e9}
            for path, s in found
        ]
        typer.echo(json.dumps(rows))
        return
    for path, scenario in found:
        typer.echo(f"{path}  {','.join(scenario.hazards) or '-':<12} {scenario.duration / 1e9:>5g} s  {scenario.name}")


@app.command()
def figures() -> None:
    """What the columns of `run` and the figures of expectations mean."""
    from hilscenario.terminal import print_figures

    print_figures()


@app.command()
def faults() -> None:
    """The vocabulary: every fault with its options, defaults and limits."""
    from hilscenario.format.vocabulary import FAULTS

    for name, kind in sorted(FAULTS.items()):
        typer.echo(f"{name:<22} {kind.about}{' (an instant)' if kind.instant else ''}")
        for option, limits in kind.options.items():
            typer.echo(f"    {option:<18} {limits.default:g} ({limits.low:g} to {limits.high:g}): {limits.about}")


@app.command()
def schema() -> None:
    """The JSON schema of the format, for editors (`# yaml-language-server: $schema=...`)."""
    from hilscenario.format.schema import Scenario

    typer.echo(json.dumps(Scenario.model_json_schema(), indent=2))


@app.command()
def run(
    paths: Paths,
    out: Annotated[Path | None, typer.Option(help="folder for recordings, pages, results.json, junit.xml")] = None,
    junit: Annotated[Path | None, typer.Option(metavar="FILE", help="JUnit XML, with or without --out")] = None,
    seed: Seed = None,
    jobs: Annotated[int, typer.Option(min=1, help="processes at once")] = os.cpu_count() or 1,
    profile: Annotated[bool, typer.Option("--profile", help="where the time goes, part by part")] = False,
    live: Annotated[bool, typer.Option("--live", help="real processes and the real clock, on --bus")] = False,
    bus: Annotated[str | None, typer.Option(help="with --live: vcan0, hilsim:NAME, any virtual bus")] = None,
    device: Annotated[
        str, typer.Option(help="simulated, or external: with --live, whatever speaks on the bus")
    ] = "simulated",
    plant_bus: Annotated[
        str | None, typer.Option(metavar="BUS", help="with --device external: run its arm on this bus (dbc/plant.dbc)")
    ] = None,
    reset_command: Annotated[
        str | None, typer.Option(metavar="COMMAND", help="with --device external: resets it, before each scenario")
    ] = None,
    i_am_on_a_bench: Annotated[
        bool, typer.Option("--i-am-on-a-bench", help="with --device external: nobody wears it; allows a physical bus")
    ] = False,
    key_file: Annotated[Path | None, typer.Option(metavar="FILE", help="with --device external: its key")] = None,
    force: Annotated[bool, typer.Option("--force", help="with --live: replace recordings that --out holds")] = False,
    as_json: Json = False,
) -> None:
    """Run scenarios and judge them; exit 1 when one fails, 2 for input that cannot be used."""
    from hilscenario.format.collect import collect, located
    from hilscenario.live.external import external_device, refuse_key
    from hilscenario.live.possible import live_bus
    from hilscenario.runner import RunOptions, refuse_recorded, run_all, sort_out
    from hilscenario.terminal import print_results, progress_bar
    from hilscenario.verdict.junit import write_junit

    external = external_device(
        device, plant_bus, reset_command, live=live, on_a_bench=i_am_on_a_bench, key_file=key_file
    )
    spec = live_bus(bus, live=live, profile=profile, external=external is not None, on_a_bench=i_am_on_a_bench)
    refuse_key(spec, external)
    named = [path for path in map(located, paths) if not path.is_dir()]
    found, skipped = sort_out(collect(paths), named, spec, external=external is not None)
    if not found:
        raise InputError(
            f"none of {len(skipped)} scenarios can run live on {spec}: {skipped[0].file}: {skipped[0].why}"
        )
    if out is not None and spec is not None and not force:
        refuse_recorded(out, [scenario for _, scenario in found])
    options = RunOptions(out, seed, 1 if profile else jobs, profile, spec, external)
    with progress_bar(len(found), quiet=as_json) as progress:
        results = run_all(found, options, progress, skipped)
    passed = all(result.passed for result in results)
    if junit is not None:
        write_junit(results, junit, skipped)
    if as_json:
        not_run = [asdict(one) for one in skipped]
        typer.echo(json.dumps({"passed": passed, "results": [r.as_json() for r in results], "skipped": not_run}))
    else:
        print_results(results, out, skipped)
    if not passed:
        raise typer.Exit(1)


@app.command()
def campaign(
    base: Annotated[Path, typer.Argument(help="the scenario that every sample starts from")],
    samples: Annotated[int, typer.Option(min=1, help="instants per fault and gate state")] = 200,
    fault: Annotated[list[str] | None, typer.Option(help="only these; default: every fault")] = None,
    seed: Annotated[int, typer.Option(min=0, help="which instants")] = 1,
    out: Annotated[Path, typer.Option(help="folder for campaign.jsonl; what it holds already is not run again")] = Path(
        "out/campaign"
    ),
    jobs: Annotated[int, typer.Option(help="processes at once; -1: all cores")] = -1,
    cluster: Annotated[
        str | None, typer.Option(help="ray, ray://HOST:PORT, dask or dask://HOST:PORT in place of local processes")
    ] = None,
    as_json: Json = False,
) -> None:
    """Inject every fault at many instants in every gate state; rank by how near each run came to hurting somebody."""
    from hilscenario.campaign import run_campaign, samples_of
    from hilscenario.format.collect import located
    from hilscenario.format.files import load_scenario
    from hilscenario.terminal import print_campaign, progress_bar

    scenario = load_scenario(located(base))
    wanted = samples_of(scenario, samples, seed, tuple(fault or ()))
    with progress_bar(len(wanted), quiet=as_json) as progress:
        outcomes = run_campaign(scenario, wanted, out, jobs=jobs, cluster=cluster, progress=progress)
    bad = [outcome for outcome in outcomes if not outcome.safe]
    if as_json:
        worst = [outcome.as_json() for outcome in outcomes[:20]]
        typer.echo(json.dumps({"samples": len(outcomes), "violations": len(bad), "worst": worst}))
    else:
        print_campaign(outcomes, base, out)
    if bad:
        raise typer.Exit(1)


@app.command()
def minimise(
    path: Annotated[Path, typer.Argument(help="a scenario that fails")],
    out: Annotated[Path | None, typer.Option(help="where to write the smaller one; default: NAME.min.yaml")] = None,
    keep: Annotated[str | None, typer.Option(help="the violated expectation to keep, or a part of its text")] = None,
    seed: Seed = None,
) -> None:
    """Shrink a failing scenario: fewer faults, shorter, simpler, as long as it still fails in the same way."""
    from hilscenario.format.collect import located
    from hilscenario.format.files import dump_scenario, load_scenario, reseeded
    from hilscenario.minimise import minimise_scenario

    scenario = reseeded(load_scenario(located(path)), seed)
    smaller = minimise_scenario(scenario, progress=lambda text: typer.echo(text, err=True), keep=keep)
    target = out or path.with_suffix(".min.yaml")
    write_whole(target, dump_scenario(smaller))
    typer.echo(f"{target}: {len(smaller.steps)} of {len(scenario.steps)} faults, {smaller.duration / 1e9:g} s")


@app.command()
def twins(
    verb: Annotated[list[str] | None, typer.Option(help="of what the person does; default: Take, Pour")] = None,
    seeds: Annotated[int, typer.Option(min=1, help="persons, from --seed on")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="the first person")] = 1,
    control: Annotated[str, typer.Option(help="steady, weak or ataxic")] = "steady",
    tremor: Annotated[
        str, typer.Option(help="none, essential, parkinsonian, cerebellar, or a file: a recorded hand (CSV, xsense.h5)")
    ] = "essential",
    preset: Annotated[str, typer.Option(help="drive: quasi-direct, series-elastic or soft")] = "quasi-direct",
    cuff: Annotated[float | None, typer.Option(min=80, max=1000, help="N m/rad; default: the preset's")] = None,
    out: Annotated[Path | None, typer.Option(help="folder for twins.json and a picture a pair")] = None,
    as_json: Json = False,
) -> None:
    """The same seed with one event changed (false ACT, wrong verb, missed assist, dropout mid-pour): what it alone does."""
    from hilscenario.terminal import print_rows, progress_bar
    from hilscenario.twins.page import TITLES, draw, worst, write
    from hilscenario.twins.page import as_json as to_json
    from hilscenario.twins.run import body_of, cases, compare, verbs_of

    body, wanted = body_of(control, tremor, preset, cuff), verbs_of(verb or ["Take", "Pour"])
    pairs = [pair for one in range(seed, seed + seeds) for pair in cases(one, body, wanted)]
    if not pairs:
        raise InputError(
            f"none of {seeds} persons from seed {seed} on ever does {', '.join(wanted)}: take more --seeds"
        )
    rows = []
    with progress_bar(len(pairs), quiet=as_json) as progress:
        for pair in pairs:
            found, run_trace, twin_trace = compare(pair)
            rows.append((pair, found))
            if out is not None:
                name = f"{pair.event}-{pair.verb}-{pair.seed}".replace(" ", "-").replace("/", "-").lower()
                draw(pair, run_trace, twin_trace, out / f"{name}.png")
            progress(pair.event)
    if out is not None:
        write(rows, out)
    if as_json:
        typer.echo(to_json(rows))
    else:
        print_rows(TITLES, worst(rows))


@app.command()
def benefit(
    people: Annotated[int, typer.Option(min=2, help="persons: cerebellar and essential tremor in turn")] = 26,
    sessions: Annotated[int, typer.Option(min=1, max=100, help="of each person")] = 2,
    seconds: Annotated[float, typer.Option(min=10, max=600, help="of a session")] = 60.0,
    first: Annotated[int, typer.Option(min=0, help="the first person")] = 0,
    raw_tau: Annotated[
        list[float] | None,
        typer.Option(min=0.1, max=1, help="of an uncalibrated gate, beside the bundle's; default: 0.65"),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="processes at once")] = os.cpu_count() or 1,
    out: Annotated[
        Path | None, typer.Option(help="folder for sessions.jsonl (what it holds is not run again), json, png")
    ] = None,
    as_json: Json = False,
) -> None:
    """Help and harm of gates on the worn arm: calibrated, uncalibrated, an ACT at every tick, device off. Same sessions."""
    from hilscenario.benefit import page
    from hilscenario.benefit.run import compare, gates
    from hilscenario.benefit.visits import visits
    from hilscenario.terminal import print_rows, progress_bar

    asked, compared = visits(people, sessions, seconds, first), gates(raw_tau or (0.65,))
    with progress_bar(len(asked), quiet=as_json) as progress:
        outcomes = compare(asked, compared, jobs, progress, None if out is None else out / "sessions.jsonl")
    if out is not None:
        page.write(outcomes, out)
    if as_json:
        typer.echo(page.as_json(outcomes))
        return
    sample = page.Sample(outcomes)
    for name, figures in page.TABLES.items():
        print_rows((name, *(one.title for one in figures)), page.table(sample, figures))
    print_rows(page.PEAK_TITLES, page.peaks(sample))
    for figures in page.TABLES.values():
        print_rows(("calibrated", *(one.title for one in figures)), page.differences(sample, figures))
    print_rows(page.EQUAL_TITLES, page.at_equal_help(sample))


show_examples(app, EXAMPLES)


def main() -> None:
    """Entry point: every way out is one line and an exit code (`hilbridge.guard`)."""
    run_guarded(app, "hilscenario")


if __name__ == "__main__":
    main()
