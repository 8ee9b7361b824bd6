"""replay: the same recording and bundle give the same decisions to the last bit; anything else is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hilbridge.errors import InputError
from hilbridge.intent.bundle import Bundle, Thresholds, demo_bundle_path, load_bundle, save_bundle
from hilbridge.observe.reading import read_recording
from hilbridge.observe.recording import Recording
from hilbridge.replay.again import Options, replay
from hilbridge.replay.difference import Compared
from hilbridge.replay.page import Traces, write_page
from hilbridge.replay.source import Source
from hilbridge.rows import ConfigRow, FeaturesRow, MetaRow, Row, TickRow
from hilscenario.format.files import scenario_of
from hilscenario.format.schema import Scenario
from hilscenario.lockstep.run import run_scenario

EXPECT = [{"that": "always device.assist_nm <= 2.001"}]
# Everything that a decision may depend on happens: dropouts, a tremor, a late tick, a bus that is cut, a bridge born anew.
TROUBLED = {
    "name": "troubled",
    "duration": "16 s",
    "seed": 7,
    "gate": {"tau_on": 0.5, "tau_off": 0.35},
    "steps": [
        {"fault": "gaze.off", "at": "4 s", "for": "400 ms"},
        {"fault": "bridge.stall", "at": "6 s", "for": "200 ms"},
        {"fault": "bus.cut", "at": "15 s", "for": "300 ms"},
        {"fault": "wearer.tremor", "at": "8 s", "for": "2 s"},
        {"fault": "bridge.restart", "at": "11 s", "with": {"down_ms": 300}},
        {"fault": "gaze.garbage", "at": "14 s", "for": "300 ms"},
    ],
    "expect": EXPECT,
}
SCRIPTED = {
    "name": "scripted",
    "duration": "4 s",
    "intent": [{"at": "0.6 s", "verb": "Pour", "confidence": 0.97}, {"at": "2 s", "verb": "Mix", "confidence": 0.95}],
    "expect": EXPECT,
}


def recorded(scenario: Scenario, path: Path) -> Path:
    run_scenario(scenario, recording=path)
    return path


@pytest.fixture(scope="module")
def troubled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(scenario_of(TROUBLED), tmp_path_factory.mktemp("troubled") / "run.mcap")


def rewritten(path: Path, target: Path, change: object) -> Path:
    """A recording with some of its rows left out or changed."""
    assert callable(change)
    with Recording(target) as out:
        for row in read_recording(path):
            if (new := change(row)) is not None and not row.topic.startswith("/signal"):
                out.write(new)
    return target


def test_the_same_bundle_gives_every_decision_confidence_and_reason_to_the_last_bit(troubled: Path) -> None:
    seen: list[Compared] = []
    difference = replay(troubled, Options(), seen.append)
    assert difference.bit_equal
    assert difference.ticks_differing == 0
    assert difference.source == "features"
    assert difference.same_bundle
    assert difference.ticks == len(seen) > 380
    assert difference.recorded == difference.now
    assert difference.now.acts > 0
    assert {str(one.row.reason) for one in seen} >= {"none", "sensor_missing", "warming_up", "overrun", "confidence"}
    assert sum(one.row.first for one in seen) == 2
    assert "to the last bit" in difference.as_text()


def test_a_script_is_replayed_from_its_beliefs(tmp_path: Path) -> None:
    difference = replay(recorded(scenario_of(SCRIPTED), tmp_path / "run.mcap"), Options())
    assert difference.source == "beliefs"
    assert difference.bit_equal
    assert difference.now.acts == 2
    assert "none: beliefs as recorded" in difference.as_text()


def test_another_threshold_decides_otherwise_and_says_where(troubled: Path, tmp_path: Path) -> None:
    traces = Traces()
    difference = replay(troubled, Options(what_if=("gate.tau_on=0.99", "gate.refractory_ms=400")), traces.watch)
    assert not difference.bit_equal
    assert difference.belief_max == 0.0  # what is believed is the same
    assert difference.ticks_differing == sum(span.ticks for span in difference.spans) > 0
    assert (difference.tau_on, difference.tau_off) == (0.99, 0.35)
    assert difference.now.coverage < difference.recorded.coverage
    assert any(span.recorded.startswith("ACT") for span in difference.spans if span.now == "HOLD confidence")
    assert not any(span.now.startswith("ACT") for span in difference.spans)
    write_page(tmp_path / "page.html", difference, traces)
    page = (tmp_path / "page.html").read_text()
    assert "<svg" in page
    assert "HOLD confidence" in page
    assert "<script" not in page


def other_bundle(path: Path, change: float) -> Path:
    bundle: Bundle = load_bundle(demo_bundle_path())
    added = np.linspace(0, change, bundle.weights.head_bias.size).astype(np.float32)
    return save_bundle(
        replace(
            bundle,
            weights=replace(bundle.weights, head_bias=bundle.weights.head_bias + added),
            vectors=replace(bundle.vectors, logits=bundle.vectors.logits + added),
            thresholds=Thresholds(0.33, 0.22),
        ),
        path,
    )


def test_another_bundle_believes_otherwise_and_keeps_the_thresholds_that_were_asked_for(
    troubled: Path, tmp_path: Path
) -> None:
    difference = replay(troubled, Options(bundle=other_bundle(tmp_path / "other.safetensors", 3.0)))
    assert not difference.same_bundle
    assert difference.belief_max > 0.01
    assert (difference.tau_on, difference.tau_off) == (0.5, 0.35)


def test_thresholds_that_nobody_asked_for_are_the_bundles_own(tmp_path: Path) -> None:
    plain = scenario_of({"name": "plain", "duration": "3 s", "expect": EXPECT})
    path = recorded(plain, tmp_path / "run.mcap")
    difference = replay(path, Options(bundle=other_bundle(tmp_path / "other.safetensors", 0.0)))
    assert (difference.tau_on, difference.tau_off) == (0.33, 0.22)


def test_features_that_were_lost_are_told(troubled: Path, tmp_path: Path) -> None:
    def lossy(row: Row) -> Row | None:
        return None if isinstance(row, FeaturesRow) and 5_000_000_000 < row.time_ns < 5_200_000_000 else row

    difference = replay(rewritten(troubled, tmp_path / "lossy.mcap", lossy), Options())
    assert difference.made.lacking == 5
    assert not difference.bit_equal
    assert "5 ticks lack their features" in difference.as_text()


def test_one_bit_of_one_confidence_is_seen(troubled: Path, tmp_path: Path) -> None:
    changed: list[TickRow] = []

    def touched(row: Row) -> Row:
        if isinstance(row, TickRow) and row.confidence > 0.3 and not changed:
            changed.append(row)
            return replace(row, confidence=float(np.nextafter(row.confidence, 1.0)))
        return row

    difference = replay(rewritten(troubled, tmp_path / "bit.mcap", touched), Options())
    assert changed
    assert not difference.bit_equal
    assert difference.ticks_differing == 0


def test_a_recording_that_begins_in_the_middle_is_one_line(troubled: Path, tmp_path: Path) -> None:
    def middle(row: Row) -> Row | None:
        return (
            row
            if row.time_ns > 3_000_000_000 or isinstance(row, MetaRow) or row.topic in ("/config", "/bundle")
            else None
        )

    with pytest.raises(InputError, match="begins in the middle of a run"):
        replay(rewritten(troubled, tmp_path / "middle.mcap", middle), Options())


def test_a_recording_without_its_settings_is_one_line(troubled: Path, tmp_path: Path) -> None:
    path = rewritten(troubled, tmp_path / "old.mcap", lambda row: None if isinstance(row, ConfigRow) else row)
    with pytest.raises(InputError, match="no /config and /bundle rows"):
        replay(path, Options())


@pytest.mark.parametrize(
    ("what_if", "said"),
    [
        ("gate.tau_onn=0.5", r"did you mean `gate\.tau_on`"),
        ("tau_on=0.5", r"did you mean `gate\.tau_on`|known: gate"),
        ("gate.tau_on=half", "`half` is no number"),
        ("gate.tau_on=0.1", "must be at least 0 and below tau_on"),
        ("gate.max_age_ms=900", r"gate\.max_age_ms: .*150"),
        ("gate.tau_on", "no such setting"),
    ],
)
def test_a_what_if_that_cannot_be_is_one_line(troubled: Path, what_if: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as refused:
        replay(troubled, Options(what_if=(what_if,)))
    assert "\n" not in str(refused.value)


def test_without_pictures_features_are_as_recorded_and_that_is_told(troubled: Path) -> None:
    difference = replay(troubled, Options(source=Source.SENSORS))
    assert difference.made.as_recorded > 300
    assert difference.bit_equal
    assert "are not in the recording" in difference.as_text()
