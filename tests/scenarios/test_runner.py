"""hilscenario.runner: what of a folder cannot run is skipped, and told everywhere."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from hilbridge.bus.port.spec import parse_spec
from hilscenario import cli
from hilscenario.format.collect import collect
from hilscenario.format.files import dump_scenario
from hilscenario.format.schema import Scenario
from hilscenario.live.run import judge_live
from hilscenario.runner import RunOptions, file_names, run_all, sort_out
from hilscenario.verdict.junit import write_junit
from tests.scenarios.made import CATALOG, happened, refused, scenario

VCAN, HILSIM = parse_spec("vcan0"), parse_spec("hilsim:x")


def test_in_a_folder_what_cannot_run_is_skipped_and_told_everywhere(tmp_path: Path) -> None:
    able, skipped = sort_out(collect([CATALOG]), [], VCAN)
    files = {Path(one.file.rpartition(":")[0]).name for one in skipped}
    assert {"bus-125k.yaml", "bus-babble.yaml", "bus-bit-errors.yaml", "bus-cut.yaml", "bus-off.yaml"} <= files
    assert len(able) + len(skipped) == len(collect([CATALOG]))
    assert len(able) >= 40
    write_junit([], tmp_path / "junit.xml", skipped)
    text = (tmp_path / "junit.xml").read_text()
    assert f'skipped="{len(skipped)}"' in text
    assert text.count("<skipped ") == len(skipped)
    assert "needs a wire that can be broken or full" in text


def test_a_folder_of_which_nothing_can_run_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cut.yaml").write_text(dump_scenario(scenario(steps=[{"fault": "bus.cut", "at": "1 ms"}])))
    assert "none of 1 scenarios can run live on vcan0" in refused(
        monkeypatch, capsys, str(tmp_path), "--live", "--bus", "vcan0"
    )


def test_skipped_ones_are_in_the_table_and_in_the_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, steps in (("cut", [{"fault": "bus.cut", "at": "1 ms"}]), ("fine", [])):
        (tmp_path / f"{name}.yaml").write_text(dump_scenario(scenario(name=name, steps=steps)))

    def at_once(asked: Scenario, spec: object, *, recording: Path | None, where: str, external: object) -> Any:
        return judge_live(asked, happened(), (), 1.0, where)

    monkeypatch.setattr("hilscenario.runner.run_live", at_once)
    for words in ([], ["--json"]):
        monkeypatch.setattr("sys.argv", ["hilscenario", "run", str(tmp_path), "--live", "--bus", "vcan0", *words])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == 0
    table, _, found = capsys.readouterr().out.rpartition("\n{")
    assert "1 of 1 passed, 1 skipped" in table
    assert "needs a wire that can be broken or full" in table
    assert [one["name"] for one in json.loads("{" + found)["skipped"]] == ["cut"]


def test_file_names_are_of_any_script_and_never_the_same_twice() -> None:
    names = [
        "a b",
        "a-b",
        "A_B",
        "\u65e5\u672c",
        "\u043f\u0440\u0438\u0432\u0435\u0442 1",
        "?!",
        "...",
        "a b 2",
        "x" * 300,
        "gate (k 1)",
        "gate (k -1)",
    ]
    given = file_names([scenario(name=name) for name in names])
    assert given[:8] == [
        "a-b",
        "a-b-2",
        "a-b-3",
        "\u65e5\u672c",
        "\u043f\u0440\u0438\u0432\u0435\u0442-1",
        "scenario",
        "scenario-2",
        "a-b-2-2",
    ]
    assert given[9:] == ["gate-k-1", "gate-k-1-2"]
    assert len(given[8]) == 100


def test_two_scenarios_with_like_names_leave_two_recordings_and_names_are_no_formulas(tmp_path: Path) -> None:
    for number, name in enumerate(("a b", "a-b", r"$\foo$ <b>", "\u65e5\u672c")):
        given = scenario(name=name, expect=[{"that": "eventually gate.act", "name": r"$\foo$ \u65e5"}])
        (tmp_path / f"{number}.yaml").write_text(dump_scenario(given), encoding="utf-8")
    out = tmp_path / "out"
    results = run_all(collect([tmp_path]), RunOptions(out))
    assert len(results) == 4
    made = sorted(path.name for path in out.iterdir() if path.suffix in (".mcap", ".html"))
    assert made == sorted(
        f"{name}.{end}" for name in ("a-b", "a-b-2", "foo-b", "\u65e5\u672c") for end in ("mcap", "html")
    )
    assert r"$\foo$ &lt;b&gt;" in (out / "foo-b.html").read_text(encoding="utf-8")
