"""What the command lines of this project share."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated

import typer
from typer.models import CommandInfo

from hilbridge import __version__


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"hilbridge {__version__}")
        raise typer.Exit


Version = Annotated[
    bool, typer.Option("--version", callback=_print_version, is_eager=True, help="print the version and end")
]


def open_in_browser(url: str) -> None:
    """Show a page to whoever sits here; where no browser can be started, say so and go on."""
    import webbrowser

    if not webbrowser.open(url):
        typer.echo(f"no browser could be started; the page is {url}", err=True)


def commands(app: typer.Typer, group: str = "") -> Iterator[tuple[str, CommandInfo]]:
    """Every command of a command line under its name as typed, those of its groups too."""
    for command in app.registered_commands:
        assert command.callback is not None
        yield f"{group}{command.name or command.callback.__name__.replace('_', '-')}", command
    for nested in app.registered_groups:
        assert nested.typer_instance is not None
        yield from commands(nested.typer_instance, f"{group}{nested.name} ")


def show_examples(app: typer.Typer, examples: Mapping[str, str]) -> None:
    """Each command's example under its help."""
    for name, command in commands(app):
        if name in examples:
            command.epilog = f"Example: {examples[name]}"
