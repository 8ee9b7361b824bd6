"""Pages of the site that the code writes: commands, scenario format, faults and figures, rows, the list of decisions."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from firmware_sim import node
from hilbridge import cli
from hilbridge.cli_examples import EXAMPLES
from hilbridge.cli_shared import commands
from hilbridge.rows.code import TOPICS, json_schema
from hilscenario import cli as scenario_cli
from hilscenario.format.schema import FIGURES, Scenario
from hilscenario.format.vocabulary import FAULTS

HERE = Path(__file__).parent


def _cell(text: object) -> str:
    """Text that stays in its cell."""
    return " ".join(str(text).split()).replace("|", "\\|").replace("<", "&lt;")


def _table(head: tuple[str, ...], lines: Iterator[tuple[object, ...]]) -> str:
    body = [f"| {' | '.join(map(_cell, line))} |" for line in lines]
    return "\n".join([f"| {' | '.join(head)} |", "|" + "---|" * len(head), *body]) if body else ""


def _options(command: Any) -> Iterator[tuple[object, ...]]:
    context = typer.Context(command)
    for option in command.params:
        if option.name == "help":
            continue
        names = ", ".join(f"`{name}`" for name in (*option.opts, *option.secondary_opts))
        shown = option.default if not callable(option.default) and option.default not in (None, False, ()) else ""
        kind = "" if getattr(option, "is_flag", False) else option.display_type(context).strip("<>")
        yield names, kind, "required" if option.required else shown, getattr(option, "help", "") or ""


def command_page() -> str:
    """Every command with its options, defaults and example."""
    text = [
        "# Commands",
        "What `--help` says, in one place. `hilbridge --install-completion` completes them in your shell.",
    ]
    programs = (("hilbridge", cli.app, EXAMPLES), ("hilscenario", scenario_cli.app, scenario_cli.EXAMPLES))
    for program, app, examples in programs:
        for name, _ in sorted(commands(app)):
            command: Any = typer.main.get_command(app)
            for word in name.split():
                command = command.get_command(None, word)
            text += [f"## {program} {name}", inspect.cleandoc(command.help or ""), f"```sh\n{examples[name]}\n```"]
            text.append(_table(("Option", "Type", "Default", "For"), _options(command)))
    text += ["## firmware-sim", "```text", node._parser().format_help().replace("__main__.py", "firmware-sim"), "```"]
    return "\n\n".join(text)


def _type_of(field: dict[str, Any]) -> str:
    if "$ref" in field:
        name = field["$ref"].rpartition("/")[2]
        return f"[{name.lstrip('_')}](#{name.lstrip('_').lower()})"
    if "anyOf" in field:
        return " or ".join(_type_of(one) for one in field["anyOf"] if one.get("type") != "null")
    if "enum" in field:
        return ", ".join(f"`{one}`" for one in field["enum"])
    if field.get("type") == "array":
        return f"list of {_type_of(field.get('items', {}))}"
    return str(field.get("type", field.get("const", "any")))


def _default_and_use(needed: bool, field: dict[str, Any]) -> tuple[object, object]:
    return "required" if needed else field.get("default", ""), field.get("description", "")


def scenario_page() -> str:
    """The format of scenarios, part by part."""
    schema = Scenario.model_json_schema()
    parts = {"Scenario": schema, **schema.get("$defs", {})}
    text = [
        "# Scenario format",
        "The same as `hilscenario schema` gives to an editor. [Scenarios](../scenarios.md) explains it.",
    ]
    for name, part in parts.items():
        if "properties" not in part:
            continue
        needed = set(part.get("required", ()))
        text += [f"## {name.lstrip('_')}", inspect.cleandoc(part.get("description", ""))]
        lines = (
            (
                f"`{key}`",
                _type_of(field),
                "required" if key in needed else field.get("default", ""),
                field.get("description", ""),
            )
            for key, field in part["properties"].items()
        )
        text.append(_table(("Key", "Type", "Default", "For"), lines))
    return "\n\n".join(text)


def fault_page() -> str:
    """Every fault with its options, every figure."""
    text = ["# Faults and figures", "## Faults"]
    for name, kind in sorted(FAULTS.items()):
        text += [f"### {name}", kind.about + (" (an instant)" if kind.instant else "")]
        lines = ((f"`{o}`", f"{v.default:g}", f"{v.low:g} to {v.high:g}", v.about) for o, v in kind.options.items())
        text.append(_table(("Option", "Default", "Limits", "For"), lines))
    text += ["## Figures", _table(("Figure", "What it is"), ((f"`{name}`", about) for name, about in FIGURES.items()))]
    return "\n\n".join(text)


def _told(record: type) -> dict[str, str]:
    """Field -> what stands under it in the source."""
    (definition,) = ast.parse(inspect.cleandoc(inspect.getsource(record))).body
    assert isinstance(definition, ast.ClassDef)
    told, last = {}, ""
    for part in definition.body:
        if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
            last = part.target.id
        elif isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant) and last:
            told[last] = str(part.value.value)
    return told


def row_page() -> str:
    """The records of a recording, topic by topic."""
    text = [
        "# Rows of a recording",
        "One frozen record of `hilbridge.rows` a topic. Units stand at the end of names. Log time is the monotonic clock, "
        "publish time the wall clock. `/signal/MESSAGE` has the signals of each CAN message ([protocol](../protocol.md)).",
    ]
    for topic, record in sorted(TOPICS.items()):
        told, schema = _told(record), json_schema(topic)
        text += [f"## {topic}", inspect.cleandoc(record.__doc__ or "")]
        lines = (
            (f"`{name}`", _type_of(field), "yes" if name in schema["required"] else "", told.get(name, ""))
            for name, field in schema["properties"].items()
        )
        text.append(re.sub(r"\[(\w+)\]\(#\w+\)", r"\1", _table(("Field", "Type", "Always", "What it is"), lines)))
    return "\n\n".join(text)


def decision_page() -> str:
    """Every decision by its number."""
    text = ["# Decisions", "Each is about ten lines: what, why, figures, and how to reverse it.", ""]
    for path in sorted((HERE / "decisions").glob("[0-9]*.md")):
        title = path.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
        text.append(f"- [{title}]({path.name})")
    return "\n".join(text)


PAGES: dict[str, Callable[[], str]] = {
    "reference/commands.md": command_page,
    "reference/scenario-format.md": scenario_page,
    "reference/faults.md": fault_page,
    "reference/rows.md": row_page,
    "decisions/index.md": decision_page,
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what the code writes."""
    for name, page in PAGES.items():
        files.append(File.generated(config, name, content=page()))
    return files
