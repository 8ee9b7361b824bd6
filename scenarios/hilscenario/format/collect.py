"""Scenario files named on a command line, folders walked, sweeps unfolded."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from hilbridge.errors import InputError
from hilscenario.format.files import load_scenario, scenario_of
from hilscenario.format.schema import Scenario

CATALOG = Path(__file__).parents[1] / "catalog"


def located(path: Path) -> Path:
    """`catalog`, and what is in it, is the one that ships wherever no such file stands here."""
    if not path.exists() and path.parts[:1] == (CATALOG.name,):
        return CATALOG.joinpath(*path.parts[1:])
    return path


def collect(paths: Iterable[Path]) -> list[tuple[Path, Scenario]]:
    """Every scenario of the files and folders, sorted within each folder. Raises InputError."""
    found: list[tuple[Path, Scenario]] = []
    for path in map(located, paths):
        files = sorted(path.glob("*.yaml")) if path.is_dir() else [path]
        if not files:
            raise InputError(f"{path}: no scenario (*.yaml) in this folder")
        for file in files:
            found += [(file, scenario) for scenario in unfold(load_scenario(file), file)]
    return found


def unfold(scenario: Scenario, where: Path | str = "scenario") -> list[Scenario]:
    """One scenario per point of its sweep: keys are dotted places such as `gate.tau_on` or `steps.0.with.share`."""
    if not scenario.sweep:
        return [scenario]
    points = []
    for values in itertools.product(*scenario.sweep.values()):
        data = scenario.model_dump(mode="json", by_alias=True, exclude={"sweep"}, exclude_none=True)
        chosen = dict(zip(scenario.sweep, values, strict=True))
        for place, value in chosen.items():
            _put(data, place, value, where)
        data["name"] = f"{scenario.name} ({', '.join(f'{k} {v}' for k, v in chosen.items())})"
        points.append(scenario_of(data, lambda location: f"{where}"))
    return points


def _put(data: Any, place: str, value: Any, where: Path | str) -> None:
    *path, last = place.split(".")
    try:
        for part in path:
            data = data[int(part)] if isinstance(data, list) else data.setdefault(part, {})
        data[int(last) if isinstance(data, list) else last] = value
    except (LookupError, ValueError, AttributeError):
        raise InputError(f"{where}: sweep `{place}` names no place of this scenario") from None
