"""Whether a camera and a gaze recording are fit to run with: what they give, against the thresholds here."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.sensors.clock import BOUND_LIMIT_NS
from hilbridge.sensors.source import SourceState

if TYPE_CHECKING:
    from hilbridge.records import GazeSample
    from hilbridge.sensors.gaze import GazeRecording
    from hilbridge.sensors.live.base import LiveDevice, LiveGaze
    from hilbridge.sensors.live.lsl import LslChannels

T = TypeVar("T")

# docs/configuration.md has these with their reasons.
LEAST_CAMERA_FPS = 10.0  # below, the newest picture is older than the sensing limit leaves room for
LEAST_GAZE_HZ = 20.0  # below the 25 Hz step less jitter, gaze is stale by itself
LEAST_INERTIAL_HZ = 40.0  # below, a tremor of 12 Hz comes with less than three samples a turn once some are lost
MOST_GAZE_HZ = 2_000.0  # no head-worn eye tracker is faster: stamps in another unit
LEAST_VALID = 0.5
NOTED_VALID = 0.8
MOST_BAD_ROWS = 0.05
LONGEST_S = 24 * 3600.0
_LISTEN_S = 1.5


class Verdict(StrEnum):
    """WELL, or NOTE (works, but worth knowing), or ILL (what it is needed for will not work)."""

    WELL = "well"
    NOTE = "note"
    ILL = "ill"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing looked at. `cure` is the command or act that mends it; empty where nothing is to mend."""

    subject: str
    verdict: Verdict
    text: str
    cure: str = ""


def tried(subject: str, look: Callable[[], str | Finding]) -> Finding:
    """What `look` finds; an InputError is ILL, its part after the semicolon the cure."""
    try:
        found = look()
    except InputError as error:
        text, _, cure = str(error).partition("; ")
        return Finding(subject, Verdict.ILL, text, cure)
    return found if isinstance(found, Finding) else Finding(subject, Verdict.WELL, found)


def check_camera(spec: str | None) -> Finding:
    """Opens the camera and looks for a second and a half how many pictures come."""
    from hilbridge.sensors.camera import CameraSource

    if spec is None:
        return Finding("camera", Verdict.NOTE, "none given", "hilbridge doctor --camera 0")

    def look() -> Finding:
        source = CameraSource(spec)
        source.start()
        begin_s = time.monotonic()
        while time.monotonic() - begin_s < _LISTEN_S and source.state in (SourceState.STARTING, SourceState.RUNNING):
            source.cell.wait(0.1)
        seconds = time.monotonic() - begin_s
        source.stop()
        size = f"{spec}: {source.width} x {source.height}"
        return judge_camera(size, source.fps, source.cell.counts().received, seconds, ended=seconds < _LISTEN_S)

    return tried("camera", look)


def judge_camera(size: str, said_fps: float, pictures: int, seconds: float, *, ended: bool) -> Finding:
    """What a camera is worth that says a rate and gave so many pictures; `ended`: a file shorter than the look."""
    text = f"{size} at {said_fps:.3g} fps"
    seen_fps = max(pictures - 1, 0) / seconds if seconds > 0 else 0.0
    if said_fps < LEAST_CAMERA_FPS:
        return Finding("camera", Verdict.ILL, f"{text}; {LEAST_CAMERA_FPS:g} are needed", "set a higher frame rate")
    if not ended and seen_fps < LEAST_CAMERA_FPS:
        seen = f"{text}, but {pictures} pictures came in {seconds:.1f} s; {LEAST_CAMERA_FPS:g} a second are needed"
        return Finding("camera", Verdict.ILL, seen, "more light, a better cable or a smaller picture")
    return Finding("camera", Verdict.WELL, text)


def check_gaze(spec: str | None, channels: LslChannels | None = None) -> Finding:
    """Reads the gaze recording, or listens to the eye tracker, and judges it."""
    from hilbridge.sensors.gaze import open_gaze
    from hilbridge.sensors.live.lsl import LslChannels
    from hilbridge.sensors.live.spec import is_live

    if spec is None:
        return Finding("gaze", Verdict.NOTE, "none given", "hilbridge doctor --gaze FOLDER")
    if is_live(spec):
        return tried("gaze", lambda: judge_tracker(*_listen(spec, channels or LslChannels())))
    return tried("gaze", lambda: judge_gaze(spec, open_gaze(Path(spec))))


def check_body(what: str, spec: str | None) -> Finding:
    """Reads the recording's inertial sensors or skeleton (`what`), or listens to those that are there."""
    from hilbridge.sensors.live.spec import is_live, open_live_body
    from hilbridge.sensors.recorded.body import BodyRecording

    if spec is None:
        return Finding(what, Verdict.NOTE, "none given", f"hilbridge doctor --{what} lsl:NAME")

    def look() -> Finding:
        if not is_live(spec):
            streams = BodyRecording(what, Path(spec)).streams
            lost = ", ".join(f"{one.name} {one.lost}" for one in streams)
            return judge_body(what, spec, {one.name: one.rate_hz for one in streams}, f"lost: {lost}")
        source = open_live_body(what, spec, {"inertial": "HAND", "skeleton": "WRIST"}[what])
        samples, seconds = _heard(source)
        counts = Counter(sample.sensor for sample in samples if sample.valid)
        rates_hz = {name: count / seconds for name, count in counts.items()}
        return judge_body(what, source.name, rates_hz, source.detail or _clock_told(source))

    return tried(what, look)


def judge_body(what: str, name: str, rates_hz: dict[str, float], told: str) -> Finding:
    """What sensors on the body are worth, by the rates of each."""
    wanted, least_hz = ("hand", LEAST_INERTIAL_HZ) if what == "inertial" else ("wrist", LEAST_GAZE_HZ)
    rates = ", ".join(f"{sensor} {rate_hz:.3g} Hz" for sensor, rate_hz in sorted(rates_hz.items())) or "nothing comes"
    text = f"{name}: {rates}{'; ' + told if told else ''}"
    of_use = [rate_hz for sensor, rate_hz in rates_hz.items() if wanted in sensor.lower()]
    if not of_use:
        return Finding(what, Verdict.ILL, text, f"a sensor with `{wanted}` in its name has to be among them")
    if min(of_use) < least_hz:
        return Finding(
            what, Verdict.ILL, f"{text}; {least_hz:g} a second are needed", "a higher rate, a better network"
        )
    return Finding(what, Verdict.WELL, text)


def _clock_told(source: LiveDevice[Any]) -> str:
    fit = None if source.clock is None else source.clock.fit
    if fit is None:
        return "stamped on arrival"
    bound_ms = fit.bound_ns(fit.newest_ns) / MS
    return f"clock known to {bound_ms:.1f} ms (residual {fit.residual_ns / MS:.2f} ms, {fit.drift_ppm:+.0f} ppm)"


def _listen(spec: str, channels: LslChannels) -> tuple[LiveGaze, list[GazeSample], float]:
    """A live eye tracker's samples over a while, and its length in seconds from the first."""
    from hilbridge.sensors.live.spec import open_live_gaze

    source = open_live_gaze(spec, channels, 0)
    samples, seconds = _heard(source)
    return source, samples, seconds


def _heard(source: LiveDevice[T]) -> tuple[list[T], float]:
    """What a live device gives over a while, and its length in seconds from the first sample. It is stopped then."""
    samples: list[T] = []
    source.on_value = samples.append
    source.start()
    begin_s = time.monotonic()
    while not samples and time.monotonic() - begin_s < 2 * _LISTEN_S:
        time.sleep(0.05)
    began_s = time.monotonic()
    time.sleep(_LISTEN_S if samples else 0.0)
    seconds = time.monotonic() - began_s
    said = source.state, source.detail
    source.stop()
    source.state, source.detail = said
    return samples, seconds


def judge_tracker(source: LiveGaze, samples: list[GazeSample], seconds: float) -> Finding:
    """What a live eye tracker is worth: its rate, its valid share, and how well its clock is known."""
    if len(samples) < 2:
        why = source.detail or "nothing comes"
        return Finding("gaze", Verdict.ILL, f"{source.name}: {why}", "is it worn, calibrated and streaming?")
    rate_hz, valid = len(samples) / seconds, sum(sample.valid for sample in samples) / len(samples)
    text = f"{source.name}: {len(samples)} samples in {seconds:.1f} s ({rate_hz:.3g} a second), {valid:.0%} valid"
    fit = None if source.clock is None else source.clock.fit
    if fit is not None:
        text += f"; {_clock_told(source)}"
        if fit.bound_ns(fit.newest_ns) > BOUND_LIMIT_NS:
            cure = "bring the phone nearer to the access point, or connect both by cable"
            return Finding("gaze", Verdict.ILL, f"{text}; 10 ms are needed", cure)
    else:
        text += "; stamped on arrival"
    if source.state is not SourceState.RUNNING:
        return Finding("gaze", Verdict.ILL, f"{text}; {source.detail}", "put the glasses on, look at the phone's app")
    if rate_hz < LEAST_GAZE_HZ:
        return Finding("gaze", Verdict.ILL, f"{text}; {LEAST_GAZE_HZ:g} a second are needed", "a better network")
    if valid < LEAST_VALID:
        return Finding("gaze", Verdict.ILL, f"{text}; {LEAST_VALID:.0%} must be valid", "check its fit and calibration")
    return Finding("gaze", Verdict.WELL, text)


def judge_gaze(spec: str, recording: GazeRecording) -> Finding:
    """What a gaze recording is worth: its rate, its valid share, its bad rows."""
    count = len(recording.time_ns)
    seconds = float(recording.time_ns[-1] - recording.time_ns[0]) / 1e9
    valid, bad = float(recording.valid.mean()), recording.bad_rows / (recording.bad_rows + count)
    rate_hz = (count - 1) / seconds if seconds > 0 else float("inf")
    text = (
        f"{spec}: {recording.format}, {count} samples in {seconds:.3g} s ({rate_hz:.4g} a second), "
        f"{valid:.0%} valid, {recording.bad_rows} bad rows"
        f"{''.join(f'; {note}' for note in recording.notes)}"
    )
    if bad > MOST_BAD_ROWS:
        cure = "export the recording again; look at the rows that cannot be read or go back in time"
        return Finding("gaze", Verdict.ILL, f"{text} ({bad:.0%}; {MOST_BAD_ROWS:.0%} at most)", cure)
    if rate_hz < LEAST_GAZE_HZ or seconds > LONGEST_S:
        cure = (
            "are the stamps in another unit (milliseconds, nanoseconds)? time_s is in seconds; else export all samples"
        )
        return Finding("gaze", Verdict.ILL, f"{text}; {LEAST_GAZE_HZ:g} a second are needed", cure)
    if rate_hz > MOST_GAZE_HZ:
        cure = "are the stamps in another unit? time_s is in seconds"
        return Finding("gaze", Verdict.ILL, f"{text}; no eye tracker gives more than {MOST_GAZE_HZ:g} a second", cure)
    if valid < LEAST_VALID:
        cure = "calibrate the eye tracker, check its fit, record again"
        return Finding("gaze", Verdict.ILL, f"{text}; {LEAST_VALID:.0%} must be valid", cure)
    if valid < NOTED_VALID:
        return Finding(
            "gaze", Verdict.NOTE, text, "gaze is often lost: the bridge holds meanwhile; check fit and light"
        )
    return Finding("gaze", Verdict.WELL, text)
