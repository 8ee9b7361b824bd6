"""Whether the sensors can be believed: what each last said, judged against its limits and the time (H8, H9). Pure."""

from __future__ import annotations

from dataclasses import dataclass

from hilbridge.config import SensorsConfig
from hilbridge.limits import MS, TICK_NS
from hilbridge.records import CameraFrame

_PROBE_STEP_PX = 16  # every 16th pixel both ways: enough to tell two pictures apart, nothing to compute


@dataclass(frozen=True, slots=True)
class SensorSeen:
    """What one source last said. `alive` is its own word; `changed_ns` is when its content last changed."""

    name: str
    alive: bool
    captured_ns: int | None
    changed_ns: int | None
    timeout_ns: int
    freeze_ns: int | None = None


class FreezeProbe:
    """Finds out when a camera's picture last changed, to the eye: colours count, not the numbers of a palette."""

    def __init__(self) -> None:
        self.changed_ns: int | None = None
        self._content = b""

    def look(self, frame: CameraFrame) -> None:
        """Compare the next picture with the one before."""
        pixels = frame.pixels[::_PROBE_STEP_PX, ::_PROBE_STEP_PX]
        content = (pixels if frame.palette is None else frame.palette.take(pixels, axis=0)).tobytes()
        if content != self._content:
            self._content, self.changed_ns = content, frame.captured_ns


def camera_seen(limits: SensorsConfig, alive: bool, captured_ns: int | None, changed_ns: int | None) -> SensorSeen:
    """The camera against its limits: silent for too long, or frozen."""
    return SensorSeen("camera", alive, captured_ns, changed_ns, limits.camera_timeout_ms * MS, limits.freeze_ms * MS)


def gaze_seen(limits: SensorsConfig, alive: bool, captured_ns: int | None, *, live: bool = False) -> SensorSeen:
    """The eye tracker against its limits. Eyes may rest on one point, so equal samples say nothing.

    A live one gives 60 samples a second or more, so it can be asked to hold *within* its limit: a tick's length less.
    """
    return SensorSeen("gaze", alive, captured_ns, None, _within(limits.gaze_timeout_ms * MS, live))


def _within(limit_ns: int, live: bool) -> int:
    return max(limit_ns - TICK_NS, limit_ns // 2) if live else limit_ns


def inertial_seen(limits: SensorsConfig, alive: bool, captured_ns: int | None, *, live: bool = False) -> SensorSeen:
    """The inertial sensors against their limit: without them nobody sees a quick tremor. Live ones as live gaze."""
    return SensorSeen("inertial", alive, captured_ns, None, _within(limits.inertial_timeout_ms * MS, live))


def hands_seen(limits: SensorsConfig, alive: bool, captured_ns: int | None) -> SensorSeen:
    """A hand detector that can die or hang, by the newest picture that it answered."""
    return SensorSeen("hands", alive, captured_ns, None, limits.camera_timeout_ms * MS)


def sensor_problem(sensor: SensorSeen, now_ns: int) -> str | None:
    """Why this source cannot be believed now, or None: gone, silent for too long, or showing the same picture.

    The text is that of a state: it names the limit, not how far it is passed, which would make it new in every tick.
    """
    if sensor.captured_ns is None:
        return f"{sensor.name} has not delivered yet"
    if not sensor.alive:
        return f"{sensor.name} is gone"
    silent_ns = now_ns - sensor.captured_ns
    if silent_ns < 0:
        return f"{sensor.name} stamps lie in the future"
    if silent_ns > sensor.timeout_ns:
        return f"{sensor.name} silent for more than {sensor.timeout_ns // MS} ms"
    if sensor.freeze_ns is not None and sensor.changed_ns is not None:
        frozen_ns = sensor.captured_ns - sensor.changed_ns
        if frozen_ns > sensor.freeze_ns:
            return f"{sensor.name} shows the same picture for more than {sensor.freeze_ns // MS} ms"
    return None


def first_problem(sensors: tuple[SensorSeen, ...], now_ns: int) -> str | None:
    """The first source that cannot be believed, in the order given. No source at all is a problem too."""
    if not sensors:
        return "no sensor is connected"
    for sensor in sensors:
        problem = sensor_problem(sensor, now_ns)
        if problem is not None:
            return problem
    return None


def still_seen(valid: tuple[bool, bool, bool], sensors: tuple[SensorSeen, ...], now_ns: int) -> tuple[bool, bool, bool]:
    """Which modalities (gaze, hands, scene) of `valid` their sources still give, so that people see which one fails."""
    failed = {sensor.name for sensor in sensors if sensor_problem(sensor, now_ns) is not None}
    camera = bool(sensors) and "camera" not in failed
    gaze, hands, scene = valid
    return bool(sensors) and gaze and "gaze" not in failed, camera and hands and "hands" not in failed, camera and scene
