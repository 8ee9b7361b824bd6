"""hilscenario.format.files: what is read is what was meant, every refusal has file, line and the nearest valid name."""

from __future__ import annotations

from pathlib import Path

import pytest

from hilbridge.errors import InputError
from hilscenario.format.collect import collect
from hilscenario.format.files import dump_scenario, load_scenario, scenario_of
from tests.scenarios.made import CATALOG

GOOD = """\
name: gaze cut while assisting
hazards: [H8]
duration: 20 s
intent:
  - {at: 1 s, verb: Take, confidence: 0.95}
steps:
  - when: device.state == Assist
    after: 100 ms
    fault: gaze.off
    for: 2 s
  - at: 3 s
    fault: bus.drop
    with: {share: 0.5}
expect:
  - that: always device.assist_nm <= 2
  - figure: acts
    at_least: 1
"""


def test_a_scenario_reads_as_the_object_the_builder_makes(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(GOOD)
    scenario = load_scenario(path)
    built = scenario_of(
        {
            "name": "gaze cut while assisting",
            "hazards": ["H8"],
            "duration": "20 s",
            "intent": [{"at": "1 s", "verb": "Take", "confidence": 0.95}],
            "steps": [
                {"when": "device.state == Assist", "after": "100 ms", "fault": "gaze.off", "for": "2 s"},
                {"at": "3 s", "fault": "bus.drop", "with": {"share": 0.5}},
            ],
            "expect": [{"that": "always device.assist_nm <= 2"}, {"figure": "acts", "at_least": 1}],
        }
    )
    assert scenario == built
    assert scenario.steps[0].for_ == 2_000_000_000
    assert scenario.steps[1].options == {"share": 0.5, "can_id": -1.0}


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ("gaze.off", "gaze.of", 7, "unknown fault `gaze.of`; did you mean `gaze.off`?"),
        ("after: 100", "aftr: 100", 8, "unknown key `steps.1.aftr`; did you mean `after`?"),
        ("after: 100 ms", "after: 100", 8, "100 is no time; write a number and its unit"),
        ("after: 100 ms", "after: 100 parsec", 8, "'100 parsec' is no time"),
        ("share: 0.5", "share: 2", 11, "`share` = 2 of fault `bus.drop`: must be 0.001 to 1"),
        ("share: 0.5", "shar: 0.5", 11, "has no option `shar`; did you mean `share`?"),
        ("figure: acts", "figure: act", 16, "unknown figure `act`; did you mean `acts`?"),
        ("verb: Take", "verb: Tak", 5, "unknown verb `Tak`; did you mean `Take`?"),
        ("assist_nm <= 2", "assist_nm <=", 15, "at its end"),
        ("[H8]", "[H12]", 2, "'H1', 'H2'"),
        ("duration: 20 s", "duraton: 20 s", 3, "did you mean `duration`?"),
        ("at: 3 s", "at: 30 s", 11, "begins at 30 s, after the end at 20 s"),
        ("at: 3 s\n", "", 11, "needs either `at` or `when`"),
        ("    at_least: 1\n", "", 16, "needs `at_least`, `at_most` or both"),
        ("name: gaze", "name: [gaze", 2, "not readable as YAML"),
    ],
)
def test_refusals_have_file_line_and_nearest_name(tmp_path: Path, old: str, new: str, line: int, said: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(GOOD.replace(old, new) if old != "at: 3 s\n" else GOOD.replace("at: 3 s\n    fault", "fault"))
    with pytest.raises(InputError) as refused:
        load_scenario(path)
    assert str(refused.value).startswith(f"{path}:{line}: ")
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_what_is_written_reads_back_equal(tmp_path: Path) -> None:
    for _, scenario in collect([CATALOG]):
        path = tmp_path / "again.yaml"
        path.write_text(dump_scenario(scenario))
        assert load_scenario(path) == scenario
