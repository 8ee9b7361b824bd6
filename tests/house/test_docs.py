"""Documents that repeat what the code says are held to it."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from hilbridge.config import Config, load_config
from hilscenario.format.files import load_scenario
from hilscenario.format.schema import FIGURES
from hilscenario.lockstep.run import run_scenario
from tests.tools import protocol_page

ROOT = Path(__file__).resolve().parents[2]


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
    for document in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]:
        for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text(encoding="utf-8")):
            of_the_site = (
                target.startswith("reference/") or target == "decisions/index.md"
            )  # docs/hooks.py writes these
            assert of_the_site or (document.parent / target).exists(), f"{document.name} links to {target}"


def test_nothing_refers_to_a_document_that_a_clone_lacks() -> None:
    absent = re.compile(r"\bPROTOCOL(?:\.md)?\b(?!\s*=)|\bDESIGN(?:\.md)?\b|\b[Ii]ssues? \d|house-moves|(?<!\w)/work/")
    named = re.compile(r"(?<![\w/])docs/[\w./-]*\w")
    for path in _texts():
        text = path.read_text(encoding="utf-8")
        found = [match[0] for match in absent.finditer(text)]
        for target in named.findall(text):
            if not (ROOT / target).exists() and not list(
                (ROOT / "docs" / "decisions").glob(f"{Path(target).name}-*.md")
            ):
                found.append(target)
        assert not found, f"{path.relative_to(ROOT)} refers to {found}"


def _texts() -> list[Path]:
    """The project's own texts; this file has the words it looks for."""
    folders = ("hilbridge", "firmware_sim", "scenarios", "tests", "docs", "dbc")
    endings = (".py", ".md", ".dbc", ".yaml", ".html", ".c")
    inside = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.suffix in endings]
    above = [*ROOT.glob("*.md"), ROOT / "pyproject.toml", ROOT / "Makefile"]
    return [path for path in (*inside, *above) if path != Path(__file__).resolve()]


def test_the_protocol_page_says_what_the_code_does() -> None:
    page = protocol_page.PAGE.read_text(encoding="utf-8")
    assert protocol_page.written(page) == page, "run `python -m tests.tools.protocol_page`"
    assert set(re.findall(r"<!-- from the code: (\w+) -->", page)) == set(protocol_page.BLOCKS)


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
