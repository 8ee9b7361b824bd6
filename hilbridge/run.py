"""One run of the bridge from start to report: recording, signals, progress, summary. `run` and `demo` share it."""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hilbridge.config import Config
from hilbridge.errors import InputError
from hilbridge.observe.recording import BackgroundRecording
from hilbridge.observe.report import write_report
from hilbridge.observe.summary import Summary
from hilbridge.priority import use_realtime_scheduling
from hilbridge.rows import CountersRow, TickRow
from hilbridge.runtime.assemble import Parts, live_bridge, meta_row
from hilbridge.runtime.judge import Judge
from hilbridge.runtime.live import LiveBridge
from hilbridge.runtime.node import Predicts
from hilbridge.runtime.senses import Senses

# Told the seconds since the start and the newest tick's row.
Progress = Callable[[float, TickRow], None]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a run left behind."""

    summary: Summary
    recording: Path
    report: Path

    def as_json(self) -> dict[str, Any]:
        return {**self.summary.as_json(), "recording": str(self.recording), "report": str(self.report)}


async def run_bridge(
    config: Config,
    parts: Parts,
    senses: Senses,
    folder: Path,
    *,
    title: str,
    seconds: float | None = None,
    judge: Judge | None = None,
    progress: Progress = lambda seconds, row: None,
    predict: Predicts | None = None,
    finish: Callable[[LiveBridge], Mapping[str, int]] = lambda live: {},
    clear_latch: bool = False,
) -> Outcome:
    """Run until `seconds` are over, a played recording ends, or SIGINT / SIGTERM; then write the report.

    SIGQUIT (Ctrl-\\) puts STOP on the bus: the device goes to ESTOP and stays there until it is cleared.

    clear_latch: authenticate the clearing of a latch or stop; somebody at the device has to confirm it there.
    finish: called when the bridge has stopped; gives counters to lay over the bridge's own in the last row.
    Raises InputError when the bus, the key or the senses cannot be used.
    """
    recording = BackgroundRecording(folder / "recording.mcap")
    begin_ns = time.monotonic_ns()

    def on_tick(row: TickRow) -> None:
        progress((time.monotonic_ns() - begin_ns) / 1e9, row)

    try:
        async with live_bridge(
            config, parts, senses, recording.write, judge=judge, on_tick=on_tick, predict=predict
        ) as live:
            recording.write(meta_row(config, parts, live.port, title, time.monotonic_ns()))
            _stop_on_signals(live)
            if clear_latch:
                live.node.bridge.request_clear_latch()
            use_realtime_scheduling()
            await live.run(seconds)
            last = {**live.counters(), **finish(live), "recording.lost_rows": recording.lost_rows}
            recording.write(CountersRow(time.monotonic_ns(), last))
    except InputError:  # it never ran: leave nothing behind
        await asyncio.to_thread(recording.discard)
        raise
    except ExceptionGroup as group:
        await asyncio.to_thread(recording.close)
        raise group.exceptions[0] from None
    await asyncio.to_thread(recording.close)
    report = folder / "report.html"
    summary = await asyncio.to_thread(write_report, recording.path, report)
    return Outcome(summary, recording.path, report)


def _stop_on_signals(live: LiveBridge) -> None:
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        try:
            loop.add_signal_handler(number, live.stop)
            if hasattr(signal, "SIGQUIT"):  # Ctrl-\: the operator's STOP
                loop.add_signal_handler(signal.SIGQUIT, live.request_stop_frame)
        except (NotImplementedError, RuntimeError):  # Windows, or not the main thread: Ctrl-C raises there
            return
