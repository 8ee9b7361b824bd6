"""An eye tracker and a hand detector of one's own: `hilbridge run --camera 0 --gaze own_sensors:Tracker --config own.toml`,
with `[sensors] hand_detector = "own_sensors:Detector"` in own.toml. Start it where this file lies, or install your package.
"""

import math
import time

from hilbridge.api import CameraFrame, Hand, HandTracks, LiveGaze, RawGaze


class Tracker(LiveGaze):
    """Looks in a circle. What it is called with stands after its name: `own_sensors:Tracker:0.3` is a radius."""

    def __init__(self, radius: str = "0.2") -> None:
        super().__init__("gaze circle", None)  # no clock of its own: samples are stamped as they arrive
        self._radius = float(radius)

    def _read_all(self) -> None:
        due_ns = self._clock_ns()
        while self._sleep_until(due_ns):  # False when the run ends
            angle = time.monotonic()
            x, y = 0.5 + self._radius * math.cos(angle), 0.5 + self._radius * math.sin(angle)
            self.take_raw(RawGaze(x, y, valid=True, worn=True))
            due_ns += 5_000_000


class Detector:
    """Sees one hand in the middle of every picture. It lives in a process of its own: it may be slow, or die."""

    def detect(self, frame: CameraFrame) -> HandTracks:
        return HandTracks(frame.captured_ns, (Hand(0.5, 0.5, score=0.9),))
