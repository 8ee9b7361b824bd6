"""hilscenario.signals.check: a formula that cannot be judged, or that has one verdict only, is refused before a run."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from hilbridge.errors import InputError
from hilscenario.format.collect import collect
from hilscenario.format.files import load_scenario, scenario_of
from hilscenario.format.schema import Scenario
from hilscenario.lockstep.run import run_scenario
from hilscenario.signals.check import formula_problem
from hilscenario.signals.domains import domains_of
from hilscenario.verdict.safety import SAFETY

CATALOG = Path(__file__).parents[3] / "scenarios" / "catalog"
DOMAINS = domains_of(["gaze.off"])


@pytest.mark.parametrize(
    "formula",
    [
        "always not device.state == Assist",
        'gate.verb == "Turn on"',
        "gate.verb == Inspect/Read",
        "gate.verb == wearer.intended",
        "150 >= device.act_age_ms",
        "always (rise(fault.gaze.off) -> eventually[0, 150 ms] device.assist_zero)",
        "gate.act == 1",
        "device.state == Assist until[0, 5 s] device.state == Ready",
        "always (gate.act -> gate.act == 1)",
        *SAFETY.values(),
    ],
)
def test_what_can_be_judged_is_let_through(formula: str) -> None:
    assert formula_problem(formula, DOMAINS) is None


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("always not device.state == ASSIST", "did you mean `Assist`?"),
        ("gate.verb == pour", "did you mean `Pour`?"),
        ("device.state == FOLOW -> gate.act", "did you mean `Follow`?"),
        ("device.state != Folow", "did you mean `Follow`?"),
        ('gate.verb == "turn on"', "did you mean `Turn on`?"),
        ("gate.reason == confidense", "did you mean `confidence`?"),
        ("device.reason == STOP_RECEIVED", "did you mean `StopReceived`?"),
        ("fault.gaze.of -> gate.act", "did you mean `fault.gaze.off`?"),
        ("fault.camera.off -> gate.act", "no signal `fault.camera.off`"),
        ("device.assist_nm == none", "no signal `none`"),
        ("Assist == device.state", "no signal `Assist`"),
        ("3 == 3", "no signal in it"),
        ("gate.act == true", "write `gate.act` or `not gate.act`"),
        ("device.state", "compare it"),
        ("device.assist_nm", "compare it"),
        ("device.state > Follow", "== and !="),
        ("device.state == device.armed", "never has a value"),
        ("device.state == gate.verb", "never has a value"),
        ("device.assist_nm == device.assist_nm", "both sides are the same"),
        ("always gate.confidence <= 1", "can never fail"),
        ("always device.act_age_ms >= 0", "can never fail"),
        ("eventually gate.confidence > 1.5", "can never hold"),
        ("abs(device.assist_nm) >= 0", "can never fail"),
        ("gate.confidence != 2", "can never fail"),
        ("always (gate.act or not gate.act)", "can never fail"),
        ("always (gate.act -> gate.act)", "can never fail"),
        ("eventually (device.state == Assist and device.state == Ready)", "can never hold"),
        ("always (device.state != Assist or device.state != Ready)", "can never fail"),
        ("always[0, 150] gate.act", "write `150 ms` or `150 s`"),
        ("always[0, 1e999 s] gate.act", "window"),
        ("always[3 ms, 1 ms] gate.act", "window"),
        ("not " * 400 + "gate.act", "nested"),
        ("not " * 3000 + "gate.act", "characters"),
        ("(" * 45 + "not " * 45 + "gate.act" + ")" * 45, "nested"),
    ],
)
def test_what_cannot_be_judged_is_refused_in_one_line(formula: str, said: str) -> None:
    problem = formula_problem(formula, DOMAINS)
    assert problem is not None
    assert said in problem
    assert "\n" not in problem


def misspellings(formula: str) -> Iterator[str]:
    """Each word of a formula without its last letter, with one too many, and with its case turned."""
    for word in re.finditer(r"[A-Za-z_][A-Za-z_./]*", formula):
        for wrong in (word[0][:-1], word[0] + word[0][-1], word[0].swapcase()):
            yield formula[: word.start()] + wrong + formula[word.end() :]


def formulas(scenario: Scenario) -> list[str]:
    asked = [step.when for step in scenario.steps] + [one.that for one in scenario.expect] + list(SAFETY.values())
    return [formula for formula in asked if formula is not None]


def test_every_misspelt_word_of_the_catalogue_is_refused() -> None:
    planted = 0
    for _, scenario in collect([CATALOG]):
        domains = domains_of(step.fault for step in scenario.steps)
        for formula in formulas(scenario):
            assert formula_problem(formula, domains) is None, formula
            for wrong in misspellings(formula):
                planted += 1
                assert formula_problem(wrong, domains) is not None, wrong
    assert planted > 10_000


BASE: dict[str, object] = {"name": "checked", "duration": "1 s"}


def test_a_refusal_names_file_and_line(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("name: a\nduration: 1 s\nexpect:\n  - {that: gate.act}\n  - {that: always device.state == FOLOW}\n")
    with pytest.raises(InputError, match=r"a\.yaml:5: `expect\.2\.that`: .*did you mean `Follow`\?"):
        load_scenario(path)


def test_a_condition_is_checked_like_an_expectation() -> None:
    step = {"fault": "gaze.off", "when": "device.state == ASSIST", "for": "100 ms"}
    with pytest.raises(InputError, match=r"steps\.1\.when.*did you mean `Assist`\?"):
        scenario_of({**BASE, "steps": [step], "expect": [{"that": "gate.act"}]})


def test_nobody_knows_what_a_recorded_wearer_intended() -> None:
    with pytest.raises(InputError, match="nobody wrote down"):
        scenario_of({**BASE, "intent": {"features": "a.npz"}, "expect": [{"that": "always gate.right"}]})


def test_a_doubled_key_is_refused_with_both_lines(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("name: a\nduration: 1 s\nexpect: [{that: gate.act}]\nduration: 2 s\n")
    with pytest.raises(InputError, match=r"a\.yaml:4: key `duration` stands here and in line 2"):
        load_scenario(path)


def test_yaml_nested_without_end_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("[" * 5000)
    with pytest.raises(InputError, match="nested too deep"):
        load_scenario(path)


def test_a_pass_that_was_never_put_to_the_test_is_known() -> None:
    asked = [
        {"that": "always (device.state == Latched -> not gate.act)"},
        {"that": "always (gate.act -> device.armed)"},
    ]
    script = [{"at": "0 s", "verb": "Pour", "confidence": 0.97}]
    result = run_scenario(scenario_of({**BASE, "duration": "3 s", "intent": script, "expect": asked})).result
    assert [judgement.is_vacuous_pass for judgement in result.judgements[:2]] == [True, False]
