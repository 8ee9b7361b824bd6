"""Documents that repeat what the code says are held to it."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from hilbridge.config import Config, load_config

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
