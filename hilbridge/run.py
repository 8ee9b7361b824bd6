"""One run of the bridge from start to report: recording, signals, progress, summary. `run` and `demo` share it."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from hilbridge.config import Config, RecordingConfig
from hilbridge.errors import InputError
from hilbridge.labels.live import MarkOptions, marking
from hilbridge.observe.keeping.background import BackgroundRecording
from hilbridge.observe.keeping.pictures import PictureFormat, Pictures
from hilbridge.observe.keeping.retention import remove_old
from hilbridge.observe.keeping.sharing import Sharing, shared_path
from hilbridge.observe.parts import Rotation
from hilbridge.observe.report import write_report
from hilbridge.observe.signals import SignalRows
from hilbridge.observe.summary import Summary
from hilbridge.priority import use_realtime_scheduling
from hilbridge.records import CameraFrame
from hilbridge.rows import CountersRow, EventRow, Look, TickRow
from hilbridge.runtime.account.judge import Judge
from hilbridge.runtime.account.stages import Stage, Stages
from hilbridge.runtime.assemble import Parts, live_bridge
from hilbridge.runtime.live import LiveBridge
from hilbridge.runtime.provenance import first_rows
from hilbridge.runtime.senses import Senses

RECORDING = "recording.mcap"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a run left behind."""

    summary: Summary
    recording: Path
    report: Path
    stages: tuple[Stage, ...] = ()

    def as_json(self) -> dict[str, Any]:
        stages = {"stages": [asdict(stage) for stage in self.stages]} if self.stages else {}
        return {**self.summary.as_json(), **stages, "recording": str(self.recording), "report": str(self.report)}


@dataclass(frozen=True, slots=True)
class RunOptions:
    """How to run.

    judge: None where the wearer's intention is not known. clear_latch: authenticate the clearing of a latch or stop;
    somebody at the device has to confirm it there. finish: called when the bridge has stopped; gives counters to lay
    over the bridge's own in the last row. profile: tell how long each stage took.
    """

    title: str
    seconds: float | None = None
    judge: Judge | None = None
    clear_latch: bool = False
    profile: bool = False
    marks: MarkOptions = field(default_factory=MarkOptions)
    finish: Callable[[LiveBridge], Mapping[str, int]] = lambda live: {}


class Watcher(Protocol):
    """Whoever looks on: a terminal, or nobody."""

    def tick(self, seconds: float, row: TickRow) -> None:
        """The seconds since the start and the newest tick."""

    def notice(self, text: str) -> None:
        """A line that a person has to read now."""

    def over(self, text: str) -> None:
        """The run is over; what is being done still."""


@contextmanager
def run_folder(
    kind: str, out: Path | None, *, force: bool, now: Callable[[], datetime] = datetime.now
) -> Iterator[Path]:
    """The folder of one run: a new one in out/, or exactly `out`. Raises InputError where it holds a recording already.

    What never began leaves no folder behind.
    """
    if out is not None:
        if (out / RECORDING).exists() and not force:
            raise InputError(f"out {out}: holds a recording already; name another folder, or replace it with --force")
        yield out
        return
    out = _new_folder(Path("out") / f"{kind}-{now():%Y%m%d-%H%M%S}")
    try:
        yield out
    except InputError:
        with suppress(OSError):
            out.rmdir()
        raise


def _new_folder(wanted: Path) -> Path:
    for again in range(1000):
        folder = wanted if not again else wanted.with_name(f"{wanted.name}-{again + 1}")
        try:
            folder.mkdir(parents=True)
            return folder
        except FileExistsError:
            continue
        except OSError as error:
            raise InputError(f"out {folder}: {error.strerror}; name a folder that can be written with --out") from None
    raise InputError(f"out {wanted}: a thousand runs in one second; name a folder with --out")


async def run_bridge(
    config: Config, parts: Parts, senses: Senses, folder: Path, options: RunOptions, watcher: Watcher
) -> Outcome:
    """Run until `seconds` are over, a played recording ends, or SIGINT / SIGTERM; then write the report.

    SIGQUIT (Ctrl-\\) puts STOP on the bus: the device goes to ESTOP and stays there until it is cleared.
    Raises InputError when the bus, the key or the senses cannot be used.
    """
    recording = BackgroundRecording(folder / RECORDING, SignalRows(parts.codec), _rotation(config.recording))
    recording.on_failure = lambda why: watcher.notice(
        f"recording {recording.path}: {why}; nothing is recorded any more"
    )
    pictures = _pictures(config, recording)
    begin_ns = time.monotonic_ns()
    stages: Stages | None = None

    def on_tick(row: TickRow) -> None:
        watcher.tick((time.monotonic_ns() - begin_ns) / 1e9, row)

    try:
        async with live_bridge(config, parts, senses, recording.write, judge=options.judge, on_tick=on_tick) as live:
            for row in first_rows(config, parts, live.port, options.title, time.monotonic_ns()):
                recording.write(row)
            if pictures is not None:
                live.on_picture = partial(_offer, pictures)
            live.on_notice = watcher.notice
            stages = live.profile() if options.profile else None
            _obey_signals(live, recording, watcher)
            if options.clear_latch:
                live.request_clear_latch()
            use_realtime_scheduling()
            with _sharing(config, live, pictures, watcher):
                async with marking(options.marks, recording.write, watcher.notice):
                    await live.run(options.seconds)
            watcher.over("over, writing the report")
            counts = {**live.counters(), **options.finish(live)}
            await asyncio.to_thread(_write_last, recording, pictures, counts)
    except InputError:  # it never ran: leave nothing behind
        await asyncio.to_thread(recording.discard)
        raise
    except ExceptionGroup as group:
        await asyncio.to_thread(recording.close)
        raise group.exceptions[0] from None
    except BaseException:  # Ctrl-C while it starts: what was begun is whole
        recording.close()
        raise
    await asyncio.to_thread(recording.close)
    if config.recording.retain_days is not None:
        await asyncio.to_thread(_forget_old, folder, config.recording.retain_days, watcher)
    report = folder / "report.html"
    try:
        summary = await asyncio.to_thread(write_report, folder, report)
    except OSError as error:
        raise InputError(
            f"report {report}: {error.strerror}; saved: {recording.path}, `hilbridge report` makes the page again"
        ) from None
    return Outcome(summary, recording.path, report, () if stages is None else stages.table())


def _rotation(config: RecordingConfig) -> Rotation:
    megabytes, minutes = config.rotate_mb, config.rotate_minutes
    return Rotation(
        None if megabytes is None else round(megabytes * 1e6), None if minutes is None else round(minutes * 60e9)
    )


def _pictures(config: Config, recording: BackgroundRecording) -> Pictures | None:
    kept = config.recording
    form = PictureFormat(kept.video_quality, kept.video_width_px, kept.blur_faces)
    if not kept.video and not config.monitor.share_pictures:
        return None
    return Pictures(form, recording.write if kept.video else None)


def _offer(pictures: Pictures, frame: CameraFrame, look: Look) -> None:
    pictures.offer(frame, look.ready_ns, look)


@contextmanager
def _sharing(config: Config, live: LiveBridge, pictures: Pictures | None, watcher: Watcher) -> Iterator[None]:
    """Share pictures with monitors inside, where that was asked for; the terminal says so."""
    if pictures is None or not config.monitor.share_pictures:
        yield
        return
    with Sharing(shared_path(str(live.port.spec))) as sharing:
        pictures.share = sharing.offer
        watcher.notice("pictures are shown to monitors of this user: whoever is in them should know")
        try:
            yield
        finally:
            pictures.share = None


def _write_last(recording: BackgroundRecording, pictures: Pictures | None, counts: Mapping[str, int]) -> None:
    """The last row has every count, of the recording itself, too."""
    own = {"recording.lost_rows": recording.lost_rows}
    if pictures is not None:
        pictures.close()
    if pictures is not None and pictures.kept:
        own["recording.pictures"] = pictures.stored
        own["recording.lost_pictures"] = pictures.dropped + pictures.failed + recording.lost_pictures
    recording.write(CountersRow(time.monotonic_ns(), {**counts, **own}))


def _forget_old(folder: Path, days: float, watcher: Watcher) -> None:
    removed = remove_old(folder, days, time.time())
    for path in removed.files:
        watcher.notice(f"removed {path}: older than {days:g} days")
    for path, why in removed.stay:
        watcher.notice(f"not removed {path}: older than {days:g} days, but {why}")


def _obey_signals(live: LiveBridge, recording: BackgroundRecording, watcher: Watcher) -> None:
    loop = asyncio.get_running_loop()
    handlers: dict[str, Callable[[], None]] = {
        "SIGINT": live.stop,
        "SIGTERM": live.stop,
        "SIGQUIT": live.request_stop_frame,  # Ctrl-\: the operator's STOP
        "SIGTSTP": lambda: _suspend(recording, watcher),  # Ctrl-Z
    }
    for name, handler in handlers.items():
        number = getattr(signal, name, None)
        if number is None:
            continue
        try:
            loop.add_signal_handler(number, handler)
        except (NotImplementedError, RuntimeError):  # Windows, or not the main thread: Ctrl-C raises there
            return


def _suspend(recording: BackgroundRecording, watcher: Watcher) -> None:
    """Stand still as told, and say what that means: to the device it is a bridge that hangs."""
    began_ns = time.monotonic_ns()
    recording.write(EventRow(began_ns, "suspended by the terminal"))
    watcher.notice(f"suspended: the device follows meanwhile; saved so far: {recording.path}")
    os.kill(os.getpid(), signal.SIGSTOP)
    now_ns = time.monotonic_ns()
    recording.write(EventRow(now_ns, f"suspended by the terminal: over after {(now_ns - began_ns) / 1e9:.2f} s"))
