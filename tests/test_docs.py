"""Documents that repeat what the code says are held to it."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from hilbridge.config import Config, load_config
from scenarios.format.files import load_scenario
from scenarios.format.schema import FIGURES
from scenarios.lockstep.run import run_scenario

ROOT = Path(__file__).resolve().parent.parent


def test_the_configuration_page_names_every_key_and_its_example_is_accepted(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "configuration.md").read_text(encoding="utf-8")
    example = re.search(r"```toml\n(.*?)```", page, re.DOTALL)
    assert example is not None
    written = tomllib.loads(example[1])
    expected = {name: set(type(getattr(Config(), name)).model_fields) for name in Config.model_fields}
    assert {section: set(keys) for section, keys in written.items()} == expected
    path = tmp_path / "bridge.toml"
    path.write_text(example[1], encoding="utf-8")
    load_config(path)


def test_links_between_documents_lead_somewhere() -> None:
    for document in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text(encoding="utf-8")):
            assert (document.parent / target).exists(), f"{document.name} links to {target}"


def test_the_scenario_page_has_an_example_that_runs_and_names_every_signal_and_figure(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "scenarios.md").read_text(encoding="utf-8")
    example = re.search(r"```yaml\n(.*?)```", page, re.DOTALL)
    assert example is not None
    path = tmp_path / "example.yaml"
    path.write_text(example[1], encoding="utf-8")
    scenario = load_scenario(path)
    assert scenario.sweep
    run = run_scenario(scenario)
    assert run.result.passed, run.result.problems()
    for name in run.trace.values:
        assert name.startswith("fault.") or f"`{name}`" in page, name
    assert all(figure in page for figure in FIGURES)
