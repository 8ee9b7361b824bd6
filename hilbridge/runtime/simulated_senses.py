"""The simulated wearer's camera and eye tracker, as sources like any other, with faults as options."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from enum import StrEnum
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hilbridge.config import SensorsConfig
from hilbridge.records import CameraFrame, GazeSample, HandTracks
from hilbridge.runtime.senses import Senses
from hilbridge.sensors.source import Source, SourceState
from hilbridge.wearer.person import Wearer

CAMERA_FPS = 25.0
_NOISE_SHIFTS = 251  # a prime, so that pattern and frame rate do not beat
GAZE_HZ = 50.0

T = TypeVar("T")


class SensorFault(StrEnum):
    """What a simulated sensor can be made to do."""

    NONE = "none"
    SILENT = "silent"  # connected, delivers nothing
    FROZEN = "frozen"  # delivers the same content with fresh stamps
    GONE = "gone"  # unplugged


class _WearerSource(Source[T]):
    def __init__(
        self,
        name: str,
        rate_hz: float,
        observe: Callable[[int], T],
        restamp: Callable[[T, int], T],
        epoch_ns: int,
        clock_ns: Callable[[], int],
    ) -> None:
        super().__init__(name, clock_ns)
        self.fault = SensorFault.NONE
        self._period_ns = round(1e9 / rate_hz)
        self._observe, self._restamp, self._epoch_ns = observe, restamp, epoch_ns

    def _read_all(self) -> None:
        due_ns = self._epoch_ns
        last: T | None = None
        while True:
            due_ns = max(due_ns + self._period_ns, self._clock_ns() - self._period_ns)
            if not self._sleep_until(due_ns):
                return
            match self.fault:
                case SensorFault.SILENT:
                    continue
                case SensorFault.GONE:
                    self.state, self.detail = SourceState.GONE, "unplugged"
                    continue
                case SensorFault.FROZEN if last is not None:
                    value = last
                case _:
                    value = last = self._observe(due_ns - self._epoch_ns)
            self._deliver(self._restamp(value, due_ns), due_ns)


class _WearerHands:
    """The simulated wearer's hands, as a detector would report them for the picture's time."""

    def __init__(self, wearer: Wearer, epoch_ns: int) -> None:
        self._wearer, self._epoch_ns = wearer, epoch_ns

    def detect(self, frame: CameraFrame) -> HandTracks:
        return replace(self._wearer.hands(frame.captured_ns - self._epoch_ns), captured_ns=frame.captured_ns)


class _NoisySensor:
    """Noise in the lowest bit, as real sensors have: without it a wearer at rest looks like a frozen camera."""

    def __init__(self, wearer: Wearer) -> None:
        self._wearer = wearer
        self._noise: NDArray[np.uint8] = np.empty(0, np.uint8)

    def frame(self, t_ns: int) -> CameraFrame:
        frame = self._wearer.frame(t_ns)
        rgb = frame.rgb
        size = rgb.size
        if self._noise.size != size + _NOISE_SHIFTS:
            self._noise = np.random.default_rng(0).integers(0, 2, size + _NOISE_SHIFTS, dtype=np.uint8)
        shift = frame.sequence % _NOISE_SHIFTS
        return replace(frame, pixels=rgb ^ self._noise[shift : shift + size].reshape(rgb.shape), palette=None)


class SimulatedSenses(Senses):
    """Senses of a `Wearer` whose time starts at `epoch_ns` of the monotonic clock."""

    camera: _WearerSource[CameraFrame]
    gaze: _WearerSource[GazeSample]

    def __init__(
        self,
        make_wearer: Callable[[], Wearer],
        config: SensorsConfig,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.epoch_ns = clock_ns()
        # A wearer caches what it has planned and is not to be shared between threads; equal seeds are equal people.
        seen, looked, held = make_wearer(), make_wearer(), make_wearer()
        camera = _WearerSource("camera", CAMERA_FPS, _NoisySensor(seen).frame, _restamp_frame, self.epoch_ns, clock_ns)
        gaze = _WearerSource("gaze", GAZE_HZ, looked.gaze, _restamp_gaze, self.epoch_ns, clock_ns)
        super().__init__(
            camera,
            gaze,
            lambda: _WearerHands(held, self.epoch_ns),
            camera_fps=CAMERA_FPS,
            config=config,
            clock_ns=clock_ns,
        )


def _restamp_frame(frame: CameraFrame, captured_ns: int) -> CameraFrame:
    return replace(frame, captured_ns=captured_ns)


def _restamp_gaze(sample: GazeSample, captured_ns: int) -> GazeSample:
    return replace(sample, captured_ns=captured_ns)
