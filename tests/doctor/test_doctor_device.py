"""doctor asks the simulated device which assist profiles it has."""

from __future__ import annotations

import subprocess

import pytest

from hilbridge import doctor
from hilbridge.doctor_sensors import Verdict


def test_the_hash_of_its_profiles_is_told() -> None:
    found = doctor.check_profiles()
    assert (found.subject, found.verdict) == ("profiles", Verdict.WELL)
    assert found.text == "of the simulated device: A6127E08, 20 verbs assisted"


def test_profiles_that_cannot_be_used_are_ill(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(command: list[str]) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, 2, "", "profiles.toml: `profile` = 1:\n write sections\n")

    monkeypatch.setattr(doctor, "run_leased", refuse)
    found = doctor.check_profiles()
    assert (found.verdict, found.text) == (Verdict.ILL, "profiles.toml: `profile` = 1: write sections")
    assert found.cure
