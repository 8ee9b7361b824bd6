"""runtime.provenance: a recording says where it comes from, and holds no key."""

from __future__ import annotations

import hashlib
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import hilbridge
from hilbridge.config import BusConfig, Config, GateSection
from hilbridge.intent.bundle import demo_bundle_path
from hilbridge.rows import BundleRow, ConfigRow, HostRow, MetaRow, Row, decode, encode
from hilbridge.runtime import provenance
from hilbridge.runtime.assemble import Parts, read_parts
from hilbridge.runtime.provenance import GIVEN, config_row, first_rows, revision

PORT: Any = SimpleNamespace(spec="vcan0", is_physical=False, listen_only=False)


@pytest.fixture(scope="module")
def parts() -> Parts:
    return read_parts(Config(gate=GateSection(tau_on=0.7, tau_off=0.5)))


def rows(parts: Parts, config: Config) -> dict[type[Any], Row]:
    made = first_rows(config, parts, PORT, "a title", 5)
    assert all(decode(row.topic, 5, encode(row)) == row for row in made)
    return {type(row): row for row in made}


def test_it_names_version_bundle_machine_and_the_gate_in_force(parts: Parts) -> None:
    made = rows(parts, Config())
    meta, bundle, config = made[MetaRow], made[BundleRow], made[ConfigRow]
    assert isinstance(meta, MetaRow)
    assert isinstance(bundle, BundleRow)
    assert isinstance(config, ConfigRow)
    assert isinstance(made[HostRow], HostRow)
    assert (meta.title, meta.version, meta.part) == ("a title", hilbridge.__version__, 1)
    assert bundle.sha256 == hashlib.sha256(demo_bundle_path().read_bytes()).hexdigest()
    assert bundle.intent == "predictor"
    assert config.settings["gate_in_force"]["tau_on"] == 0.7
    assert config.settings["gate"]["tau_on"] is None


def test_keys_and_their_files_are_left_out_and_that_one_was_given_is_not(parts: Parts) -> None:
    made = rows(parts, Config(bus=BusConfig(key_file="/home/somebody/arm.key")))
    assert not any(b"arm.key" in encode(row) for row in made.values())
    config = made[ConfigRow]
    assert isinstance(config, ConfigRow)
    assert config.settings["bus"]["key_file"] == GIVEN
    assert config_row({"bus": {"key_file": None}}, parts, 0).settings["bus"]["key_file"] is None
    nested = config_row({"bus": {"options": {"Password": "x", "api_token": "y", "bitrate": 5}}}, parts, 0)
    assert nested.settings["bus"]["options"] == {"Password": GIVEN, "api_token": GIVEN, "bitrate": 5}


def test_the_commit_is_that_of_the_checkout_or_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    known = revision()
    assert known is None or len(known) == 40

    def absent(*_: object, **__: object) -> None:
        raise FileNotFoundError("git")

    monkeypatch.setattr(subprocess, "run", absent)
    provenance.revision.cache_clear()
    assert revision() is None
    provenance.revision.cache_clear()


def test_no_commit_is_asked_for_where_the_sources_are_no_checkout(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(provenance, "__file__", str(tmp_path / "a" / "b" / "provenance.py"))
    provenance.revision.cache_clear()
    assert revision() is None
    provenance.revision.cache_clear()
