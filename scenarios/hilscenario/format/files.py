"""Scenario files: read and checked, with file, line and the nearest valid name in every refusal; written again."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from hilbridge.errors import InputError
from hilscenario.format.schema import (
    BusPart,
    DevicePart,
    Estimate,
    Expectation,
    GatePart,
    Scenario,
    Session,
    Step,
    WearerPart,
)


def load_scenario(path: Path) -> Scenario:
    """Read a YAML scenario. Raises InputError: one line with file, line, what is wrong and the nearest valid name."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        data = yaml.safe_load(text)
    except RecursionError:
        raise InputError(f"{path}:1: nested too deep to be a scenario") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = mark.line + 1 if mark is not None else 1
        raise InputError(f"{path}:{line}: not readable as YAML: {getattr(error, 'problem', error)}") from None
    for node in _mappings(root):
        _refuse_doubled(path, node)
    if not isinstance(data, dict):
        raise InputError(f"{path}:1: a scenario is a mapping with `name`, `duration` and `expect`")
    if isinstance(data.get("intent"), dict):
        data["intent"] = _beside(path, data["intent"])
    return scenario_of(data, where=lambda location: f"{path}:{_line(root, location)}")


def _mappings(root: yaml.Node | None) -> Iterator[yaml.MappingNode]:
    waiting, seen = [root], set()
    while waiting:
        node = waiting.pop()
        if id(node) in seen:  # an alias
            continue
        seen.add(id(node))
        if isinstance(node, yaml.MappingNode):
            yield node
            waiting += [part for pair in node.value for part in pair]
        elif isinstance(node, yaml.SequenceNode):
            waiting += node.value


def _refuse_doubled(path: Path, node: yaml.MappingNode) -> None:
    """YAML's own reader takes the last of two equal keys, and says nothing."""
    lines: dict[str, int] = {}
    for key, _ in node.value:
        line = key.start_mark.line + 1
        if key.value in lines:
            raise InputError(f"{path}:{line}: key `{key.value}` stands here and in line {lines[key.value]}; keep one")
        lines[str(key.value)] = line


def _beside(path: Path, session: dict[str, Any]) -> dict[str, Any]:
    """A recorded session with its files' whole paths."""
    files = ("features", "recording", "folder", "video", "gaze")
    return {
        key: str((path.parent / value).resolve()) if key in files and isinstance(value, str) else value
        for key, value in session.items()
    }


def scenario_of(data: dict[str, Any], where: Any = lambda location: "scenario") -> Scenario:
    """The Python builder's form of the same. Raises InputError naming the place that `where` gives to a location."""
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        chosen = max(error.errors(), key=_aptness)
        location = _location(chosen)
        raise InputError(f"{where(location)}: {_explain(chosen, location)}") from None


def _location(error: ErrorDetails) -> tuple[int | str, ...]:
    """Where in the file: pydantic's own names for the members of a union (`tuple[Estimate, ...]`) are left out."""
    if error["type"] == "part":
        place: tuple[int | str, ...] = error["ctx"]["place"]
        return place
    return tuple(part for part in error["loc"] if isinstance(part, int) or "[" not in part)


def _aptness(error: ErrorDetails) -> tuple[bool, int]:
    """Sort key: a misspelt key explains more than a missing one, a deep error more than a shallow one."""
    return error["type"] == "extra_forbidden", len(_location(error))


def _explain(error: ErrorDetails, location: tuple[int | str, ...]) -> str:
    key = ".".join(str(part + 1) if isinstance(part, int) else part for part in location)
    if error["type"] == "extra_forbidden":
        known = _keys_at(location[:-1])
        near = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.5)
        return f"unknown key `{key}`; " + (f"did you mean `{near[0]}`?" if near else f"known here: {', '.join(known)}")
    if error["type"] == "missing":
        return f"`{key}` is missing"
    message = str(error["msg"]).removeprefix("Value error, ")
    return f"`{key}`: {message}" if key else message


def _keys_at(location: tuple[int | str, ...]) -> list[str]:
    parts: dict[str, type[BaseModel]] = {
        "wearer": WearerPart,
        "gate": GatePart,
        "bus": BusPart,
        "device": DevicePart,
        "steps": Step,
        "expect": Expectation,
        "intent": Estimate,
    }
    model = parts.get(str(location[0]), Scenario) if location else Scenario
    if location == ("intent",):
        model = Session
    return [field.alias or name for name, field in model.model_fields.items()]


def _line(node: Any, location: tuple[int | str, ...]) -> int:
    """The line of the deepest part of `location` that the file has."""
    line = 1 if node is None else node.start_mark.line + 1
    for part in location:
        found = None
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                if key.value == str(part):
                    line, found = key.start_mark.line + 1, value
        elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
            found = node.value[part]
            line = found.start_mark.line + 1
        if found is None:
            return int(line)
        node = found
    return int(line)


def line_of(path: Path, location: tuple[int | str, ...]) -> int:
    """The line of a scenario file that has that part of it; 1 for a file that has changed under us."""
    try:
        root = yaml.compose(path.read_text(encoding="utf-8-sig"), Loader=yaml.SafeLoader)
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return 1
    return _line(root, location)


def reseeded(scenario: Scenario, seed: int | None) -> Scenario:
    """The same scenario with another seed; None leaves it as it is."""
    return scenario if seed is None else scenario.model_copy(update={"seed": seed})


def dump_scenario(scenario: Scenario) -> str:
    """YAML that `load_scenario` reads back to an equal object; what has its default is left out."""
    data = scenario.model_dump(mode="json", by_alias=True, exclude_defaults=True, exclude_none=True)
    text: str = yaml.safe_dump(data, sort_keys=False, width=110, allow_unicode=True)
    return text
