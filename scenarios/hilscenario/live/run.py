"""One scenario live: played by the director, put on the same grid of signals as in virtual time, judged by the same rules."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from hilbridge.bus.port.spec import BusSpec
from hilbridge.errors import InputError
from hilbridge.files import naming
from hilbridge.limits import MS
from hilbridge.observe.recording import Recording
from hilbridge.observe.signals import SignalRows
from hilbridge.rows import BundleRow, ConfigRow, CountersRow, DeviceRow, EventRow, HostRow, MetaRow, Row, shifted
from hilscenario.format.schema import Expectation, Scenario
from hilscenario.live.director import Director
from hilscenario.live.external import External
from hilscenario.live.logs.bridge import put_bridge
from hilscenario.live.logs.device import assist_figures, device_columns
from hilscenario.live.logs.happened import Happened
from hilscenario.signals.trace import Trace
from hilscenario.signals.tracks import Tracks
from hilscenario.verdict.figures import figures_of_ticks, zero_after_fault_ms
from hilscenario.verdict.judging import FaultCount, Judgement, Result, judged
from hilscenario.verdict.outcome import Run, first_rows, initial_values, with_derived
from hilscenario.verdict.safety import safety_expectations
from hilscenario.world.parts import codec

# A live tick may be up to 40 ms late before the bridge itself holds for it, and a live process has 10 ms of margin
# (docs/protocol.md); the device's own deadlines are judged on its own clock and need none.
LIVE_MARGIN_MS = {"zero_after_fault_ms": 50.0}


def run_live(
    scenario: Scenario,
    spec: BusSpec,
    *,
    recording: Path | None = None,
    where: str = "scenario",
    external: External | None = None,
) -> Run:
    """Run with real processes in real time and judge. Raises InputError for a bus or process that cannot be had."""
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="hilscenario-") as folder:
        director = Director(scenario, spec, Path(folder), external)
        director.run()
    happened = director.happened
    if recording is not None:
        write_recording(scenario, spec, happened, recording)
    faults = tuple(FaultCount(*row) for row in director.board.effects())
    return judge_live(scenario, happened, faults, time.monotonic() - began_s, where, by_bus=external is not None)


def judge_live(
    scenario: Scenario,
    happened: Happened,
    faults: tuple[FaultCount, ...],
    took_s: float,
    where: str,
    *,
    by_bus: bool = False,
) -> Run:
    """Signals, figures and verdicts of what was recorded; `by_bus`: the device was heard, not read."""
    if not happened.device_lines:
        raise InputError(f"{where}: the device's log is empty; is the disk full?")
    seconds = scenario.duration / 1e9
    trace = live_trace(scenario, happened)
    ticks = [row for row in happened.ticks if 0 <= row.time_ns <= scenario.duration]
    summary = happened.device_summary
    figures = {
        **figures_of_ticks(ticks),
        **assist_figures(trace.values),
        "max_assist_nm": float(summary.get("peak_assist_nm", 0.0)),
        "zero_after_fault_ms": zero_after_fault_ms(trace),
        "trips": float(summary.get("trips", 0)),
        "frames_rejected": float(sum(summary.get("rejected", {}).values())),
        "frames_lost": float(all_counters(happened)["frames_lost"]),
    }
    expected = tuple(with_margin(expectation) for expectation in scenario.expect)
    judgements = judged(expected, trace, figures, safety=False, where=where)
    judgements += judged(safety_expectations(live=True, by_bus=by_bus), trace, figures, safety=True, where=where)
    judgements += (_all_lived(happened),)
    result = Result(scenario.name, scenario.seed, judgements, faults, figures, seconds, took_s, live=True)
    return Run(result, trace, ticks, scenario)


def with_margin(expectation: Expectation) -> Expectation:
    """The same expectation with the margin that a live run has."""
    margin_ms = LIVE_MARGIN_MS.get(expectation.figure or "", 0.0)
    if expectation.at_most is None or not margin_ms:
        return expectation
    return expectation.model_copy(update={"at_most": expectation.at_most + margin_ms})


def live_trace(scenario: Scenario, happened: Happened) -> Trace:
    """Every signal on the grid of 1 ms that virtual time has, too."""
    tracks = Tracks()
    for now_ns, signals in happened.fault_signals:
        for name, value in signals.items():
            tracks.put(now_ns / MS, name, value)
    put_bridge(tracks, happened.ticks, happened.away)
    trace = tracks.trace(scenario.duration / MS, initial_values(scenario))
    columns = device_columns(happened.device_lines, happened.start_ns, trace.length)
    silent = trace.silent - columns.keys()
    return with_derived(Trace(trace.step_ms, trace.length, {**trace.values, **columns}, silent))


def last_counters(happened: Happened) -> dict[str, int]:
    """The bridge's counters, summed over all its processes; one that was killed had told them up to a second before."""
    total: dict[str, int] = {"frames_lost": 0}
    last: dict[str, int] = {}
    for row in happened.bridge_rows:
        if isinstance(row, MetaRow):  # the next process
            total, last = _sum(total, last), {}
        elif isinstance(row, CountersRow):
            last = dict(row.counts)
    return _sum(total, last)


def _sum(total: dict[str, int], more: dict[str, int]) -> dict[str, int]:
    return total | {name: total.get(name, 0) + value for name, value in more.items()}


def _all_lived(happened: Happened) -> Judgement:
    text = "no process ends by itself"
    lived = not happened.died
    name = text if lived else f"{text}: {', '.join(happened.died)}"
    return Judgement(name, text, lived, 1.0 if lived else -1.0, None)


def write_recording(scenario: Scenario, spec: BusSpec, happened: Happened, path: Path) -> None:
    """Everything that both sides and the director wrote, in order of time, as one MCAP file like virtual time's."""
    with naming(path), Recording(path, SignalRows(codec())) as out:
        for first in first_rows(scenario, str(spec), happened.start_ns):
            out.write(first)
        for row in sorted(_all_rows(happened), key=lambda row: row.time_ns):
            out.write(shifted(row, -happened.start_ns))
        out.write(CountersRow(scenario.duration, all_counters(happened)))


def all_counters(happened: Happened) -> dict[str, int]:
    """The bridge's counters, the intruder's, and what the device said of itself in its last words."""
    summary = happened.device_summary
    said = {f"device.{name}": value for name, value in summary.items() if isinstance(value, int)}
    rejected = {f"device.rejected_{why}": count for why, count in summary.get("rejected", {}).items()}
    bridge = last_counters(happened)
    lost = int(summary.get("lost_frames", 0)) + bridge["frames_lost"]
    return {
        **bridge,
        **said,
        **rejected,
        "intruder.send_dropped": happened.intruder_dropped,
        "frames_lost": lost,
    }


def _all_rows(happened: Happened) -> Iterator[Row]:
    for row in happened.bridge_rows:
        # What the bridge heard of the device stands in its /can rows; /device is the device's own word, as elsewhere.
        if not isinstance(row, DeviceRow | MetaRow | HostRow | ConfigRow | BundleRow):
            yield row
    yield from (line.row for line in happened.device_lines)
    yield from happened.faults
    for time_ns, text in happened.events:
        yield EventRow(time_ns, text)
