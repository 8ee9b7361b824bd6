"""The worker thread that turns each picture into features, off the event loop: pixels in, FeatureVector out."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol

import cv2

from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.wrists import WristHands, stood_in
from hilbridge.priority import Level, take_level
from hilbridge.records import CameraFrame, FeatureVector, GazeSample, HandTracks
from hilbridge.rows import Look
from hilbridge.runtime.account.stages import Stages
from hilbridge.runtime.health import FreezeProbe
from hilbridge.sensors.cell import LatestCell


class FindsHands(Protocol):
    """A hand detector (sensors.hands), or the simulated wearer's own word; None is a detector that gave no answer."""

    def detect(self, frame: CameraFrame) -> HandTracks | None: ...


class VisionWorker:
    """Takes the newest picture, finds hands, assembles features with the newest gaze, leaves them in `vectors`.

    `find_hands` is made in the worker's own thread (MediaPipe wants one thread) and may be None: hands are then masked.
    `on_vector` is called in the worker's thread after each, then `on_look` with the picture and all that was made of it.
    `hands_alive` is the detector's own word where it has one, `hands_ns` the newest picture that it answered.
    `freeze` knows when the picture's content last changed. `wrists` stand in for hands that the picture does not show.
    """

    def __init__(
        self,
        frames: LatestCell[CameraFrame],
        gaze: LatestCell[GazeSample] | None,
        find_hands: Callable[[], FindsHands] | None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.vectors: LatestCell[FeatureVector] = LatestCell()
        self.ready = threading.Event()
        self.failure: Exception | None = None
        self.freeze = FreezeProbe()
        self.frames_with_hands = 0
        self.last_ready_ns: int | None = None
        self.hands_alive: bool | None = None  # None: nothing that can die finds them
        self.hands_ns: int | None = None
        self.stages: Stages | None = None  # where times are told, if anybody wants them
        self.wrists: WristHands | None = None
        self.on_event: Callable[[str], None] = lambda text: None
        self.on_vector: Callable[[], None] = lambda: None
        self.on_look: Callable[[CameraFrame, Look], None] = lambda frame, look: None
        self._frames, self._gaze = frames, gaze
        self._find_hands = find_hands
        self._clock_ns = clock_ns
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="vision", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(2.0)
        self.vectors.close()

    def _run(self) -> None:
        take_level(Level.VISION)
        cv2.setNumThreads(1)  # picture work must not spread over the processor that the tick needs
        detector: FindsHands | None = None
        try:
            detector = self._find_hands() if self._find_hands else None
            if detector is not None and hasattr(detector, "on_event"):
                detector.on_event = lambda text: self.on_event(text)
            self.hands_alive = getattr(detector, "alive", None)
            self.ready.set()
            assembler = FeatureAssembler()
            while not self._stopping.is_set():
                frame = self._frames.wait(0.1)
                if frame is not None:
                    self._step(frame, detector, assembler)
        except Exception as error:  # the bridge sees it as features that stop, says why, and holds
            self.failure = error
        finally:
            self.ready.set()
            close = getattr(detector, "close", None)
            if close is not None:
                close()

    def _step(self, frame: CameraFrame, detector: FindsHands | None, assembler: FeatureAssembler) -> None:
        begin_ns = self._clock_ns()
        self.freeze.look(frame)
        hands = detector.detect(frame) if detector is not None else None
        looked_ns = self._clock_ns()
        self.hands_alive = getattr(detector, "alive", None)
        self.hands_ns = self.hands_ns if hands is None else frame.captured_ns
        self.frames_with_hands += bool(hands and hands.hands)
        hands = stood_in(hands, self.wrists, frame.captured_ns)
        gaze = self._gaze.take() if self._gaze is not None else None
        vector = assembler.update(frame, gaze, hands, frame.captured_ns)
        ready_ns = self.last_ready_ns = self._clock_ns()
        if self.stages is not None:
            self.stages.add("capture -> vision", begin_ns - frame.captured_ns)
            if detector is not None:
                self.stages.add("hands", looked_ns - begin_ns)
            self.stages.add("features", ready_ns - looked_ns)
            self.stages.add("capture -> features", ready_ns - frame.captured_ns)
        self.vectors.put(vector)
        self.on_vector()
        self.on_look(frame, Look(ready_ns, vector, frame.sequence, gaze, hands))
