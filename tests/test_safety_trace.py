"""CI fails when a hazard or a number of the contract has no test, or docs/safety.md is out of date."""

from __future__ import annotations

from tests.safety import requirements


def test_every_hazard_and_number_has_a_test() -> None:
    assert requirements.missing() == []


def test_the_threat_model_names_tests_that_there_are() -> None:
    assert requirements.by_hand().count("`\n") + requirements.by_hand().count("` |") > 20
    assert requirements.absent() == []


def test_the_document_is_up_to_date() -> None:
    assert requirements.DOCUMENT.read_text(encoding="utf-8") == requirements.document(), (
        "run `python -m tests.safety.requirements`"
    )


def test_an_entry_without_a_test_would_be_noticed(monkeypatch: object) -> None:
    known = requirements.REQUIREMENTS
    try:
        requirements.REQUIREMENTS = {**known, "X1": "nobody holds this"}
        assert requirements.missing() == ["X1"]
    finally:
        requirements.REQUIREMENTS = known
