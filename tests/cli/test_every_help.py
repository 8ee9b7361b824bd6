"""What every command says about itself."""

from __future__ import annotations

import shlex
import subprocess
import sys

import pytest
import typer

from hilbridge import __version__, cli
from hilbridge.cli_examples import EXAMPLES
from hilbridge.cli_shared import commands
from hilscenario import cli as scenario_cli

PROGRAMS = {"hilbridge": (cli.app, EXAMPLES), "hilscenario": (scenario_cli.app, scenario_cli.EXAMPLES)}
CASES = [(program, name) for program, (app, _) in PROGRAMS.items() for name, _ in commands(app)]


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_command_has_one_example_and_none_is_of_a_command_that_went(program: str) -> None:
    app, examples = PROGRAMS[program]
    assert {name for name, _ in commands(app)} == set(examples)


@pytest.mark.parametrize(("program", "name"), CASES)
def test_its_example_is_a_command_line_that_it_takes(program: str, name: str) -> None:
    app, examples = PROGRAMS[program]
    words = shlex.split(examples[name])
    assert words[: 1 + len(name.split())] == [program, *name.split()]
    command = typer.main.get_command(app)
    with command.make_context(program, words[1:]) as context:
        for word in name.split():
            arguments = [*context._protected_args, *context.args]  # what a group leaves for its command
            found = context.command.get_command(context, word)  # type: ignore[attr-defined]  # it is a group
            assert found is not None
            context = found.make_context(word, arguments[1:], parent=context)
    assert not context.args


@pytest.mark.parametrize(("program", "name"), CASES)
def test_every_option_says_what_it_is_for(program: str, name: str) -> None:
    command = typer.main.get_command(PROGRAMS[program][0])
    for word in name.split():
        command = command.get_command(None, word)  # type: ignore[attr-defined]  # it is a group
    silent = [option.name for option in command.params if not getattr(option, "help", None) and option.name != "help"]
    assert silent == []
    assert command.help


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_version_is_printed(program: str, capsys: pytest.CaptureFixture[str]) -> None:
    PROGRAMS[program][0](["--version"], standalone_mode=False)
    assert capsys.readouterr().out.split() == ["hilbridge", __version__]


@pytest.mark.parametrize("words", [[], ["run"], ["monitor"], ["train"]])
def test_help_loads_nothing_that_only_the_work_needs(words: list[str]) -> None:
    code = (
        f"import sys\nsys.argv = ['hilbridge', *{words!r}, '--help']\nfrom hilbridge.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'asyncio', 'numpy', 'cv2', 'can', 'yaml', 'torch', 'scipy', 'aiohttp'} & set(sys.modules)\n"
        "sys.exit(', '.join(heavy) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
