"""`hilbridge tune`: its options, a progress bar, a table or one JSON object."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from hilbridge.errors import InputError


def register(app: typer.Typer) -> None:
    """Add it to the command line."""
    app.command()(tune)


def tune(
    files: Annotated[
        list[Path], typer.Argument(help="of one wearer: recordings, hand acceleration as CSV (t_s,x,y,z), or xsense.h5")
    ],
    precision: Annotated[
        float, typer.Option(min=0.01, max=0.99, help="that ACT is to keep, by the bundle's replay and the wearer's own")
    ] = 0.9,
    bundle: Annotated[Path | None, typer.Option("--bundle", help="default: the configuration's, or what ships")] = None,
    config: Annotated[Path | None, typer.Option("--config", help="bridge.toml whose tau_on is in use")] = None,
    profiles: Annotated[
        Path | None, typer.Option("--profiles", help="the wearer's profiles.toml of now; default: what ships")
    ] = None,
    control: Annotated[str, typer.Option(help="how the wearer moves: steady, weak or ataxic")] = "steady",
    cuff: Annotated[float | None, typer.Option(min=80, max=1000, help="N m/rad, of soft straps to a shell")] = None,
    out: Annotated[Path | None, typer.Option(help="the diff that a clinician signs, such as tuned.diff")] = None,
    force: Annotated[bool, typer.Option("--force", help="replace a file that is there already")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="print one JSON object instead of text")] = False,
) -> None:
    """Propose tau_on, damping and caps for one wearer from their recordings; it only ever takes away, and changes nothing."""
    from hilbridge.files import write_whole
    from hilbridge.terminal import print_rows, steps
    from hilbridge.tune.device import Asked
    from hilbridge.tune.page import TITLES
    from hilbridge.tune.run import Wish
    from hilbridge.tune.run import tune as propose

    if out is not None and out.exists() and not force:
        raise InputError(f"{out}: is there already; name another file, or replace it with --force")
    wish = Wish(tuple(files), precision, Asked(profiles, control, cuff), bundle, config)
    with steps("trials", quiet=as_json) as begin:
        found = propose(wish, begin, lambda line: typer.echo(line, err=True))
    if out is not None and found.diff:
        write_whole(out, found.diff)
    if as_json:
        typer.echo(json.dumps(found.as_json(), sort_keys=True, allow_nan=False))
        return
    print_rows(TITLES, found.rows())
    typer.echo(f"profiles {found.profiles.old_hash} -> {found.profiles.new_hash}")
    if not found.diff:
        typer.echo("nothing to change")
    elif out is None:
        typer.echo(found.diff, nl=False)
    else:
        typer.echo(f"diff to sign: {out}")
