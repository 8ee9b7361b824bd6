"""Whether the sensors can be believed, as a pure function of what they last said and the time (hazard H8, H9)."""

from __future__ import annotations

from dataclasses import dataclass

from hilbridge.limits import MS


@dataclass(frozen=True, slots=True)
class SensorSeen:
    """What one source last said. `alive` is its own word; `changed_ns` is when its content last changed."""

    name: str
    alive: bool
    captured_ns: int | None
    changed_ns: int | None
    timeout_ns: int
    freeze_ns: int | None = None


def sensor_problem(sensor: SensorSeen, now_ns: int) -> str | None:
    """Why this source cannot be believed now, or None: gone, silent for too long, or showing the same picture."""
    if sensor.captured_ns is None:
        return f"{sensor.name} has not delivered yet"
    if not sensor.alive:
        return f"{sensor.name} is gone"
    silent_ns = now_ns - sensor.captured_ns
    if not 0 <= silent_ns <= sensor.timeout_ns:
        return f"{sensor.name} silent for {silent_ns // MS} ms"
    if sensor.freeze_ns is not None and sensor.changed_ns is not None:
        frozen_ns = sensor.captured_ns - sensor.changed_ns
        if frozen_ns > sensor.freeze_ns:
            return f"{sensor.name} shows the same picture for {frozen_ns // MS} ms"
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
