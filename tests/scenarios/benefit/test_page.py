"""Tables, intervals and harm at equal help, from made-up sessions."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hilscenario.benefit import page
from hilscenario.benefit.measured import PEAKS, SUMS
from hilscenario.benefit.run import ALWAYS, CALIBRATED, OFF, UNCALIBRATED, Outcome
from hilscenario.benefit.visits import Visit

ON_TARGET, WORK = page.ON_TARGET, page.HARM[0]
# (share on target, mJ a minute) of each device
MADE = {
    OFF: (0.5, 0.0),
    CALIBRATED: (0.6, 2.0),
    UNCALIBRATED: (0.55, 2.0),
    f"{UNCALIBRATED} 0.6": (0.65, 6.0),
    ALWAYS: (0.7, 9.0),
}


def _outcomes(made: dict[str, tuple[float, float]] | None = None) -> list[Outcome]:
    rows = []
    for person in range(6):
        for device, (on_target, harm) in (made or MADE).items():
            sums = dict.fromkeys((*SUMS, *PEAKS), 1.0)
            sums |= {
                "seconds": 60.0,
                "acting_s": 10.0,
                "on_target_s": 10.0 * on_target + 0.1 * person,
                "wrong_j": 1e-3 * harm,
            }
            rows.append(Outcome(device, Visit(person, 0), sums))
    return rows


def test_a_figure_has_an_interval_by_person_and_a_difference_of_twins_has_none() -> None:
    sample = page.Sample(_outcomes())
    found = sample.figure(OFF, ON_TARGET)
    assert found.value == pytest.approx(52.5)
    assert 50.0 <= found.low < found.value < found.high <= 55.0
    apart = sample.apart(CALIBRATED, OFF, ON_TARGET)
    assert (apart.low, apart.value, apart.high) == pytest.approx((10.0, 10.0, 10.0))


def test_equal_help_lies_between_two_thresholds() -> None:
    found = page.Sample(_outcomes()).at_equal_help(ON_TARGET, WORK)
    assert (found.low, found.value, found.high) == pytest.approx((-2.0, -2.0, -2.0))  # 4 mJ/min halfway, less 2


def test_where_no_uncalibrated_gate_helps_as_much_nothing_is_said() -> None:
    on_target, *others = page.at_equal_help(page.Sample(_outcomes({**MADE, CALIBRATED: (0.9, 2.0)})))
    assert set(on_target[1:]) == {"-"}
    assert len(others) == len(page.HELP) - 1


def test_a_line_a_device_and_one_a_comparison() -> None:
    sample = page.Sample(_outcomes())
    assert [row[0] for row in page.table(sample, page.FIGURES)] == list(MADE)
    assert {len(row) for row in page.table(sample, page.FIGURES)} == {1 + len(page.FIGURES)}
    assert [row[0] for row in page.differences(sample, page.HELP)] == [
        f"less {one}" for one in MADE if one != CALIBRATED
    ]
    assert {len(row) for row in page.differences(sample, page.HELP)} == {1 + len(page.HELP)}
    assert {len(row) for row in page.at_equal_help(sample)} == {len(page.EQUAL_TITLES)}
    assert {len(row) for row in page.peaks(sample)} == {len(page.PEAK_TITLES)}


def test_json_and_picture(tmp_path: Path) -> None:
    page.write(_outcomes(), tmp_path)
    found = json.loads((tmp_path / "benefit.json").read_text())
    assert set(found["figures"]) == {"all", "cerebellar", "essential"}
    assert found["figures"]["cerebellar"]["people"] == 3
    assert found["figures"]["all"]["devices"][CALIBRATED][WORK.title][0] == pytest.approx(2.0)
    assert len(found["sessions"]) == 6 * len(MADE)
    assert (tmp_path / "benefit.png").stat().st_size > 10_000


def test_what_has_nothing_to_divide_by_is_a_dash() -> None:
    rows = _outcomes()
    for row in rows:
        row.sums["carrying_s"] = 0.0
    assert page.table(page.Sample(rows), page.SPILL[:1])[0] == (OFF, "-")
