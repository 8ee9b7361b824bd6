"""`hilbridge check`: a look through the bridge's own senses before a session; well, or what to mend, and one picture."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hilbridge.doctor_sensors import LEAST_CAMERA_FPS, LEAST_GAZE_HZ, LEAST_VALID, Finding, Verdict, judge_body
from hilbridge.limits import MS, SENSING_LIMIT_MS

if TYPE_CHECKING:
    from hilbridge.records import CameraFrame
    from hilbridge.rows import ClockRow, Look, SourceAccount
    from hilbridge.runtime.senses import Senses

_CLOCK_LIMIT_MS = 10.0


@dataclass
class Seen:
    """What came while one looked. Ages are from capture to features, in milliseconds."""

    seconds: float = 0.0
    ages_ms: list[float] = field(default_factory=list)
    gaze_valid: list[bool] = field(default_factory=list)
    gaze_ages_ms: list[float] = field(default_factory=list)
    hands: list[int] = field(default_factory=list)
    last: tuple[CameraFrame, Look] | None = None
    accounts: dict[str, SourceAccount] = field(default_factory=dict)
    clocks: tuple[ClockRow, ...] = ()
    events: list[str] = field(default_factory=list)
    body: Counter[str] = field(default_factory=Counter)
    felt: str = ""


def look(senses: Senses, seconds: float, show: Callable[[str], None]) -> Seen:
    """Run the senses for a while. `show` is told in a line how it stands, once a second. Raises InputError."""
    seen, lock = Seen(), threading.Lock()

    def on_look(frame: CameraFrame, one: Look) -> None:
        with lock:
            seen.ages_ms.append((one.ready_ns - frame.captured_ns) / MS)
            seen.hands.append(len(one.hands.hands) if one.hands is not None else -1)
            seen.gaze_valid.append(one.vector.valid[0])
            if one.gaze is not None:
                seen.gaze_ages_ms.append((one.ready_ns - one.gaze.captured_ns) / MS)
            seen.last = (frame, one)
        senses.take()

    senses.vision.on_look = on_look
    senses.vision.on_event = seen.events.append
    senses.body.on_sample = lambda kind, sample: seen.body.update([sample.sensor] if sample.valid else [])
    for device in senses.devices:
        device.on_event = seen.events.append
    try:
        senses.start()
        began_s = time.monotonic()
        while (passed_s := time.monotonic() - began_s) < seconds and not senses.ended:
            time.sleep(min(1.0, seconds - passed_s))
            with lock:
                show(_line(seen))
        seen.seconds = time.monotonic() - began_s
        felt = senses.body.felt
        if felt is not None:
            said = "a tremor" if felt.trembling else "no tremor"
            line = felt.line
            seen.felt = said if line is None else f"{said}: {line.hz:.1f} Hz, {line.rms:.2f} m/s^2"
        seen.accounts, seen.clocks = senses.accounts(), senses.clocks(time.monotonic_ns())
    finally:
        senses.stop()
    return seen


def _line(seen: Seen) -> str:
    if seen.last is None:
        return "no picture yet"
    one = seen.last[1]
    gaze = "none" if one.gaze is None else f"{one.gaze.x:.2f} {one.gaze.y:.2f}{'' if one.gaze.valid else ' invalid'}"
    hands = "-" if one.hands is None else str(len(one.hands.hands))
    return f"pictures {len(seen.ages_ms)}, age {seen.ages_ms[-1]:.0f} ms; gaze {gaze}; hands {hands}"


def judge(seen: Seen, *, with_gaze: bool, with_hands: bool) -> list[Finding]:
    """What was seen, against what a session needs. Pure."""
    findings = [_camera(seen)]
    if with_gaze:
        findings.append(_gaze(seen))
    else:
        findings.append(Finding("gaze", Verdict.NOTE, "none given", "hilbridge check --gaze neon:"))
    if with_hands:
        findings.append(_hands(seen))
    findings += [_body(what, seen) for what in ("inertial", "skeleton") if what in seen.accounts]
    findings += [_clock(clock) for clock in seen.clocks]
    return findings


def _camera(seen: Seen) -> Finding:
    account = seen.accounts.get("camera")
    if not seen.ages_ms or account is None:
        return Finding("camera", Verdict.ILL, "no picture came", "hilbridge doctor --camera 0")
    rate_hz = len(seen.ages_ms) / seen.seconds
    p50, p99 = np.percentile(seen.ages_ms, [50, 99])
    text = (
        f"{rate_hz:.1f} a second, capture to features {p50:.0f} ms (p99 {p99:.0f}), "
        f"{account.overwritten} overwritten, {account.failed} failed"
    )
    if rate_hz < LEAST_CAMERA_FPS:
        return Finding("camera", Verdict.ILL, text, "more light, a smaller picture, or a better cable")
    if p99 > SENSING_LIMIT_MS / 2:
        return Finding("camera", Verdict.NOTE, text, "a smaller picture, or a machine with less to do")
    return Finding("camera", Verdict.WELL, text)


def _gaze(seen: Seen) -> Finding:
    account = seen.accounts.get("gaze")
    if account is None or not account.received or not seen.gaze_ages_ms:
        why = seen.events[-1] if seen.events else "no sample came"
        return Finding("gaze", Verdict.ILL, why, "is it worn, calibrated and streaming?")
    rate_hz, valid = account.received / seen.seconds, float(np.mean(seen.gaze_valid))
    p50, p99 = np.percentile(seen.gaze_ages_ms, [50, 99])
    text = f"{rate_hz:.0f} a second, in {valid:.0%} of the pictures, age {p50:.0f} ms (p99 {p99:.0f}), {account.failed} failed"
    if rate_hz < LEAST_GAZE_HZ or valid < LEAST_VALID:
        return Finding("gaze", Verdict.ILL, text, "check its fit, its calibration and the network")
    return Finding("gaze", Verdict.WELL, text)


def _clock(clock: ClockRow) -> Finding:
    text = f"{clock.device}: known to {clock.bound_ms:.1f} ms, residual {clock.residual_ms:.2f} ms, set {clock.steps} times"
    if clock.bound_ms > _CLOCK_LIMIT_MS:
        return Finding("clock", Verdict.ILL, text, "bring the phone nearer to the access point, or use a cable")
    return Finding("clock", Verdict.WELL, text)


def _body(what: str, seen: Seen) -> Finding:
    wanted = "hand" if what == "inertial" else "wrist"
    rates_hz = {sensor: count / seen.seconds for sensor, count in seen.body.items()}
    said = seen.felt if what == "inertial" else ""
    return judge_body(what, what, {one: hz for one, hz in rates_hz.items() if wanted in one.lower()}, said)


def _hands(seen: Seen) -> Finding:
    asked, found = len(seen.hands), sum(count > 0 for count in seen.hands)
    missed = sum(count < 0 for count in seen.hands)
    text = f"in {found} of {asked} pictures, no answer for {missed}"
    if not asked or missed > asked / 10:
        return Finding("hands", Verdict.ILL, text, "a smaller picture, or a machine with less to do")
    if not found:
        return Finding("hands", Verdict.NOTE, text, "hold both hands into the picture and look again")
    return Finding("hands", Verdict.WELL, text)


def draw(seen: Seen, path: Path) -> bool:
    """The last picture with its gaze and hands; False where there was none."""
    import cv2

    if seen.last is None:
        return False
    frame, one = seen.last
    picture = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR)
    height, width = picture.shape[:2]
    size = max(4, width // 100)
    for hand in one.hands.hands if one.hands is not None else ():
        cv2.circle(picture, (round(hand.x * width), round(hand.y * height)), 2 * size, (0, 200, 0), max(1, size // 3))
    if one.gaze is not None and one.gaze.valid:
        cv2.circle(picture, (round(one.gaze.x * width), round(one.gaze.y * height)), size, (0, 0, 255), -1)
    return bool(cv2.imwrite(str(path), picture))
