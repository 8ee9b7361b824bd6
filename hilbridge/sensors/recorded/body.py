"""Inertial and skeleton samples of a recording, played in step with its gaze."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from heapq import merge
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.records import BodySample, StampSource
from hilbridge.sensors.recorded.iassistadl import INERTIAL, SKELETON, IAssistRecording, Stream, read_iassistadl
from hilbridge.sensors.source import Source, begins_again_ns

FILES = {"inertial": INERTIAL, "skeleton": SKELETON}


class BodyRecording:
    """The samples of a folder's `what` (inertial, skeleton), on the clock of its gaze, whose first sample is at 0.

    offset_ns: added to their stamps. Raises InputError for a folder without them.
    """

    def __init__(self, what: str, folder: Path, offset_ns: int = 0) -> None:
        if not folder.is_dir():
            raise InputError(f"{what} {folder}: no such folder; give lsl:STREAM, udp:PORT or a recording's folder")
        found = read_iassistadl(folder)
        self.streams = streams_of(what, found)
        if not self.streams:
            raise InputError(f"{what} {folder}: has no {FILES[what]}, or nothing of use in it; leave --{what} out")
        self.origin_ns = int(found.gaze.time_ns[0]) - offset_ns

    def samples(self) -> Iterator[BodySample]:
        """All of them in their order, stamped from 0; what was before is left out."""
        return (sample for sample in merge(*map(self._of, self.streams), key=_when) if sample.captured_ns >= 0)

    def _of(self, stream: Stream) -> Iterator[BodySample]:
        stamps = (stream.time_ns - self.origin_ns).tolist()
        for when_ns, (x, y, z) in zip(stamps, stream.values.tolist(), strict=True):
            good = math.isfinite(x) and math.isfinite(y) and math.isfinite(z)
            x, y, z = (x, y, z) if good else (0.0, 0.0, 0.0)
            yield BodySample(when_ns, stream.name, x, y, z, good, StampSource.HARDWARE)


def streams_of(what: str, recording: IAssistRecording) -> tuple[Stream, ...]:
    """The streams of a recording that `what` means, those with samples."""
    streams = recording.inertial if what == "inertial" else recording.wrists
    return tuple(stream for stream in streams if len(stream.time_ns))


def _when(sample: BodySample) -> int:
    return sample.captured_ns


class BodyPlayer(Source[BodySample]):
    """Plays a recording in real time from the moment it is started; `loop` starts again at its end."""

    def __init__(
        self,
        what: str,
        recording: BodyRecording,
        *,
        loop: bool = False,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(what, clock_ns)
        self.recording = recording
        self._loop = loop

    def _read_all(self) -> None:
        started_ns = self._clock_ns()
        while True:
            due_ns = before_ns = started_ns
            for sample in self.recording.samples():
                before_ns, due_ns = due_ns, started_ns + sample.captured_ns
                if not self._sleep_until(due_ns):
                    return
                self._deliver(replace(sample, captured_ns=due_ns), due_ns)
            if not self._loop:
                return
            started_ns = begins_again_ns(started_ns, due_ns - started_ns, due_ns - before_ns, self._clock_ns())
