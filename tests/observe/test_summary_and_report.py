"""observe.summary and observe.report: fixed definitions, a page that a browser can read."""

from __future__ import annotations

import html.parser
from pathlib import Path
from typing import Any

import pytest

from hilbridge.observe.recording import Recording
from hilbridge.observe.report import write_report
from hilbridge.observe.summary import latency_of, percentile, summarise
from hilbridge.records import Action, HoldReason
from hilbridge.rows import CountersRow, DeviceRow, EventRow, MetaRow, Row, TickRow, Witness

TICK = 40_000_000


def tick(
    index: int, verb: str | None = None, truth: str | None = None, reason: str = "confidence", **more: Any
) -> TickRow:
    action, why = (Action.HOLD, reason) if verb is None else (Action.ACT, "none")
    right = None if verb is None or truth is None else verb == truth
    known = {"truth_known": truth is not None, "truth": truth, "right": right}
    return TickRow(index * TICK, action, HoldReason(why), 0.5, verb, **{"latency_ms": 30.0, **known, **more})


def device(time_ns: int, state: str, assist_nm: float) -> DeviceRow:
    return DeviceRow(time_ns, Witness.BUS, state, "None", True, "None", assist_nm == 0.0, assist_nm, 0.1)


def scripted() -> list[Row]:
    """HOLD, ACT right, ACT right, HOLD, ACT wrong, ACT unknown truth, HOLD for a named reason: six intervals."""
    return [
        tick(0, truth="Take"),
        tick(1, "Take", "Take"),
        tick(2, "Take", "Take", latency_ms=50.0),
        tick(3, truth="Take"),
        tick(4, "Put", "Take"),
        tick(5, "Put", None),
        tick(6, reason="not_armed", latency_ms=None),
        device(0, "Ready", 0.0),
        device(1 * TICK, "Assist", 0.5),
        device(3 * TICK, "Ready", 0.0),
        device(3 * TICK + 1, "Ready", 0.0),
        CountersRow(0, {"frames_sent": 1}),
        CountersRow(6 * TICK, {"frames_sent": 9, "frames_received": 8, "frames_lost": 1, "ticks_missed": 2}),
    ]


def test_definitions() -> None:
    summary = summarise(scripted())
    assert (summary.acts, summary.holds, summary.ticks) == (2, 3, 7)
    assert summary.seconds == pytest.approx(0.24)
    assert summary.coverage == pytest.approx(4 / 7)
    assert summary.act_only_precision == pytest.approx(2 / 3)  # the tick of unknown truth is not judged
    assert summary.false_assists_per_min == pytest.approx(1 / (0.24 / 60))
    assert summary.hold_reasons == {"confidence": 2, "not_armed": 1}
    assert summary.verbs_acted == {"Take": 2, "Put": 2}
    assert summary.device_states == {"Ready": 3, "Assist": 1}
    assert summary.assist_s == pytest.approx(0.06)  # no row for 80 ms: believed for 60
    assert (summary.frames_sent, summary.frames_received, summary.frames_lost) == (9, 8, 1)
    assert (summary.ticks_missed, summary.latency_ms.p50, summary.latency_ms.max) == (2, 30.0, 50.0)


def test_nothing_recorded_is_no_precision_rather_than_a_perfect_one() -> None:
    summary = summarise([])
    assert summary.act_only_precision is None
    assert (summary.coverage, summary.seconds, summary.ticks) == (0.0, 0.0, 0)
    assert summary.latency_ms.p99 is None


@pytest.mark.parametrize(("share", "value"), [(0.0, 1), (0.5, 2), (0.75, 3), (0.99, 4), (1.0, 4)])
def test_percentiles_are_values_that_were_seen(share: float, value: int) -> None:
    assert percentile([4, 1, 3, 2], share) == value
    assert latency_of([4, 1, 3, 2]).max == 4


class _Checker(html.parser.HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.text: list[str] = []
        self.tags: list[str] = []

    def handle_data(self, data: str) -> None:
        self.text.append(data)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        assert not any(
            (value or "").startswith(("http:", "https:")) for name, value in attrs if name in ("src", "href")
        )


def test_the_page_says_what_happened_and_needs_no_network(tmp_path: Path) -> None:
    recording = tmp_path / "run.mcap"
    with Recording(recording) as out:
        out.write(MetaRow(0, title="A <b>scripted</b> run", tau_on=0.8, tau_off=0.6))
        out.write(EventRow(TICK, "gaze is gone"))
        for row in scripted():
            out.write(row)
    target = tmp_path / "deep" / "report.html"
    summary = write_report(recording, target)
    page = target.read_text(encoding="utf-8")
    checker = _Checker()
    checker.feed(page)
    text = " ".join(checker.text)
    assert summary.acts == 2
    assert "0.67" in text
    assert "gaze is gone" in text
    assert "A <b>scripted</b> run" in text
    assert checker.tags.count("svg") == 2
    assert "<b>scripted</b>" not in page


def test_a_recording_without_ticks_still_gives_a_page(tmp_path: Path) -> None:
    with Recording(tmp_path / "a.mcap") as out:
        out.write(MetaRow(0))
    write_report(tmp_path / "a.mcap", tmp_path / "a.html")
    assert "it never held" in (tmp_path / "a.html").read_text(encoding="utf-8")
