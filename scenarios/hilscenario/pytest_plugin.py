"""The pytest plugin: `*.hil.yaml` are tests, and there are fixtures for a bus, a device, a bridge and scenarios.

pytest imports this file in every run on a machine that has the package, so it imports nothing of ours before it is used.
"""

from __future__ import annotations

import itertools
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from hilbridge.demo import DeviceProcess
    from hilscenario.format.schema import Scenario
    from hilscenario.pytest_bridge import TestBridge
    from hilscenario.verdict.judging import Result

SUFFIX = ".hil.yaml"
_numbers = itertools.count(1)


class ScenarioFailed(AssertionError):
    """A scenario whose expectations do not hold; the text is all that a person needs."""


def pytest_configure(config: pytest.Config) -> None:
    """Leave our modules as they are. pytest rewrites the asserts of every package that comes with a plugin: here it would
    compile three hundred modules anew, two seconds and more, for asserts that no test of anybody reads.
    """
    marked = getattr(getattr(config.pluginmanager, "rewrite_hook", None), "_must_rewrite", None)
    if isinstance(marked, set):
        marked -= {"hilbridge", "firmware_sim", "hilscenario"}


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Every `*.hil.yaml` is a file of tests: one, or one for each point of its sweep."""
    return ScenarioFile.from_parent(parent, path=file_path) if file_path.name.endswith(SUFFIX) else None


class ScenarioFile(pytest.File):
    """One `*.hil.yaml`."""

    def collect(self) -> Iterable[pytest.Item]:
        """Its scenarios. Raises CollectError: one line with file, line, what is wrong and the nearest valid name."""
        from hilbridge.errors import InputError
        from hilscenario.format.collect import collect

        try:
            found = collect([self.path])
        except InputError as error:
            raise self.CollectError(str(error)) from None
        for _, scenario in found:
            yield ScenarioItem.from_parent(self, name=scenario.name, scenario=scenario)


class ScenarioItem(pytest.Item):
    """One scenario, run in virtual time."""

    def __init__(self, *, scenario: Scenario, **arguments: Any) -> None:
        super().__init__(**arguments)
        self._scenario = scenario

    def runtest(self) -> None:
        """Run and judge it."""
        run_judged(self._scenario, _folder(self.config), self.path)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """What failed, in words: a trace through our code would say nothing."""
        from hilbridge.errors import InputError

        if isinstance(excinfo.value, ScenarioFailed | InputError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Where it stands."""
        return self.path, None, f"scenario: {self.name}"


def run_judged(scenario: Scenario, folder: Path, path: Path | None) -> Result:
    """Run it in virtual time. Raises ScenarioFailed, having left a page, and the scenario where it had no file."""
    from hilscenario.format.files import dump_scenario
    from hilscenario.lockstep.run import run_scenario
    from hilscenario.runner import file_name
    from hilscenario.verdict.page import write_page

    run = run_scenario(scenario, where=str(path or scenario.name))
    if run.result.passed:
        return run.result
    stem = f"{file_name(scenario.name)}-{scenario.seed}"
    page = write_page(run, folder / f"{stem}.html")
    if path is None:
        path = folder / f"{stem}.yaml"
        path.write_text(dump_scenario(scenario), encoding="utf-8")
    raise ScenarioFailed(failure_text(run.result, path, page))


def failure_text(result: Result, path: Path, page: Path) -> str:
    """Each violated formula with its margin and when, faults without effect, the picture, the command that repeats it."""
    import shlex

    lines = [f"scenario {result.name} fails"]
    for one in result.judgements:
        if not one.holds:
            when = "" if one.at_ms is None else f" at {one.at_ms:.0f} ms"
            value = "" if one.value is None else f", value {one.value:.4g}"
            lines += [f"  {one.name}" if one.name and one.name != one.text else "", f"  violated: {one.text}"]
            lines.append(f"    margin {one.margin:.4g}{value}{when}")
    lines += [f"  fault {one.fault} never took effect" for one in result.faults if not one.worked]
    lines.append(f"picture: {page}")
    lines.append(f"repeat: {shlex.join(['hilscenario', 'run', str(path), '--seed', str(result.seed)])}")
    return "\n".join(line for line in lines if line)


def _folder(config: pytest.Config) -> Path:
    """Where pages of failures go: pytest's cache, or a folder of their own where that is switched off."""
    cache = getattr(config, "cache", None)
    return Path(tempfile.mkdtemp(prefix="hilscenario-")) if cache is None else cache.mkdir("hilscenario")


@pytest.fixture
def hil_bus() -> str:
    """The name of a simulated bus of this test's own, which other processes reach: `hilsim:...`."""
    return f"hilsim:pytest-{os.getpid()}-{next(_numbers)}"


@pytest.fixture
def simulated_device(hil_bus: str, tmp_path: Path) -> Iterator[DeviceProcess]:
    """The simulated device, a process of its own on `hil_bus`. After `stop()` its `summary` says what it counted."""
    from hilbridge.demo import DeviceProcess

    device = DeviceProcess(hil_bus, tmp_path / "device.jsonl")
    yield device
    device.stop()


@pytest.fixture
def bridge(hil_bus: str, tmp_path: Path) -> TestBridge:
    """The bridge with a simulated wearer, on `hil_bus`: `bridge.run(seconds=5)` gives an outcome with its summary."""
    from hilscenario.pytest_bridge import TestBridge

    return TestBridge(hil_bus, tmp_path / "bridge")


@pytest.fixture
def scenario(request: pytest.FixtureRequest) -> Callable[..., Result]:
    """`scenario("catalog/ataxia.yaml")`, a file beside the test, or a mapping: runs it, fails unless all holds."""

    def run(what: str | Path | Mapping[str, Any], *, seed: int | None = None) -> Result:
        from hilscenario.format.collect import located
        from hilscenario.format.files import load_scenario, reseeded, scenario_of

        if isinstance(what, Mapping):
            return run_judged(reseeded(scenario_of(dict(what)), seed), _folder(request.config), None)
        path = located(Path(what))
        path = path if path.exists() else request.path.parent / path
        return run_judged(reseeded(load_scenario(path), seed), _folder(request.config), path)

    return run
