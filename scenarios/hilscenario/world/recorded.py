"""A recorded session in the wearer's place: features of a pack, video and gaze, or a folder of the iAssistADL group.

All are functions of the scenario's time, so that lockstep runs repeat to the byte. Recordings: `world.replayed`.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace
from pathlib import Path
from typing import Protocol
from zipfile import BadZipFile

import cv2
import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError
from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import STEP_NS, drop_modality
from hilbridge.features.packs import read_pack
from hilbridge.features.wrists import WristHands, projection_of
from hilbridge.limits import SENSING_LIMIT_NS
from hilbridge.records import (
    BodySample,
    CameraFrame,
    FeatureVector,
    GazeSample,
    Hand,
    HandTracks,
    Modality,
    StampSource,
)
from hilbridge.runtime.account.judge import Mind
from hilbridge.sensors.gaze import iassistadl_recording, open_gaze
from hilbridge.sensors.hands import HandDetector
from hilbridge.sensors.models import hand_model_path, load_hand_model
from hilbridge.sensors.recorded.body import FILES, BodyRecording
from hilscenario.format.schema import Session

_GREY = np.full((72, 96, 3), 128, np.uint8)
BLANK, ONLY_GREY = np.zeros((72, 96), np.uint8), np.full((1, 3), 128, np.uint8)  # the same, drawn


class Person(Protocol):
    """What sensors see of a wearer (wearer.person.Wearer, or a recorded session). Times are the wearer's."""

    def frame(self, t_ns: int) -> CameraFrame: ...

    def gaze(self, t_ns: int) -> GazeSample: ...

    def hands(self, t_ns: int) -> HandTracks: ...

    def truth(self, t_ns: int) -> Mind | None: ...


class Unlabelled:
    def truth(self, t_ns: int) -> Mind | None:
        """None: the intention of a recorded wearer is not known."""
        return None


class Unseen(Unlabelled):
    """The person of a session whose features are recorded: every sensor delivers samples without content."""

    def frame(self, t_ns: int) -> CameraFrame:
        return CameraFrame(t_ns, BLANK, t_ns // STEP_NS, StampSource.HARDWARE, ONLY_GREY)

    def gaze(self, t_ns: int) -> GazeSample:
        return GazeSample(t_ns, 0.5, 0.5, True, StampSource.HARDWARE)

    def hands(self, t_ns: int) -> HandTracks:
        return HandTracks(t_ns, (Hand(0.5, 0.6, 1.0),))


class Filmed(Unlabelled):
    """A session's video and gaze, and hands where they are looked for."""

    def __init__(self, session: Session, duration_ns: int) -> None:
        """Raises InputError naming the file that is absent, unreadable or too short."""
        assert session.video is not None
        assert session.gaze is not None
        self._from_ns = session.from_
        self._video = Video(Path(session.video))
        long_enough(f"video {session.video}", self._video.duration_ns, session.from_, duration_ns)
        self._gaze = open_gaze(Path(session.gaze))
        long_enough(f"gaze {session.gaze}", int(self._gaze.time_ns[-1]), session.from_, duration_ns)
        if session.hands:
            load_hand_model(hand_model_path())
        self._detector: HandDetector | None = None  # made by the thread that looks for hands: it wants one thread

    def frame(self, t_ns: int) -> CameraFrame:
        index, rgb = self._video.at(self._from_ns + t_ns)
        return CameraFrame(t_ns, rgb, index, StampSource.HARDWARE)

    def gaze(self, t_ns: int) -> GazeSample:
        recording = self._gaze
        row = max(0, int(np.searchsorted(recording.time_ns, self._from_ns + t_ns, side="right")) - 1)
        x, y, valid = float(recording.x[row]), float(recording.y[row]), bool(recording.valid[row])
        return GazeSample(t_ns, x, y, valid, StampSource.HARDWARE)

    def hands(self, t_ns: int) -> HandTracks:
        if self._detector is None:
            self._detector = HandDetector(hand_model_path())
        return self._detector.detect(self.frame(t_ns))

    def close(self) -> None:
        """Free the detector's graph: it must not be left to the garbage collector."""
        if self._detector is not None:
            self._detector.close()
            self._detector = None


class Worn(Unlabelled):
    """What the iAssistADL group's sensors gave: gaze, wrists as hands, the hands' acceleration.

    The folder has no picture of the eye tracker's own camera, so nothing is seen of the scene unless a video is named; and
    where wrists lie in the picture has to be said.
    """

    def __init__(self, session: Session, duration_ns: int) -> None:
        """Raises InputError for a folder that cannot be read, or ends before the scenario."""
        assert session.folder is not None
        folder = Path(session.folder)
        self._from_ns = session.from_
        self._gaze = iassistadl_recording(folder)
        long_enough(f"folder {folder}: gaze", int(self._gaze.time_ns[-1]), session.from_, duration_ns)
        self._times = self._gaze.time_ns.tolist()
        self._video = None if session.video is None else Video(Path(session.video))
        if self._video is not None:
            long_enough(f"video {session.video}", self._video.duration_ns, session.from_, duration_ns)
        self._wrists: list[BodySample] = []
        if session.projection is not None:
            self._projection = projection_of(session.projection)
            self._wrists = list(BodyRecording("skeleton", folder).samples())
        has_inertial = (folder / FILES["inertial"]).is_file()
        self.felt = list(BodyRecording("inertial", folder).samples()) if has_inertial else []
        self._felt_times = [sample.captured_ns for sample in self.felt]
        self._wrist_times = [sample.captured_ns for sample in self._wrists]

    def frame(self, t_ns: int) -> CameraFrame:
        """The video's picture, or one without content, of which features know nothing (`SceneLess`)."""
        if self._video is None:
            return CameraFrame(t_ns, BLANK, t_ns // STEP_NS, StampSource.HARDWARE, ONLY_GREY)
        index, rgb = self._video.at(self._from_ns + t_ns)
        return CameraFrame(t_ns, rgb, index, StampSource.HARDWARE)

    def gaze(self, t_ns: int) -> GazeSample:
        """The newest sample; one that is too old is none."""
        row = bisect_right(self._times, self._from_ns + t_ns) - 1
        if row < 0:
            return GazeSample(t_ns, 0.0, 0.0, False, StampSource.HARDWARE)
        recording = self._gaze
        fresh = self._from_ns + t_ns - self._times[row] <= SENSING_LIMIT_NS
        x, y, valid = float(recording.x[row]), float(recording.y[row]), bool(recording.valid[row])
        return GazeSample(t_ns, x, y, valid and fresh, StampSource.HARDWARE)

    def hands(self, t_ns: int) -> HandTracks:
        """The wrists of that moment, as far as they are in the picture."""
        if not self._wrists:
            return HandTracks(t_ns, ())
        now_ns = self._from_ns + t_ns
        placed = WristHands(self._projection)
        until = bisect_right(self._wrist_times, now_ns)
        for sample in self._wrists[bisect_right(self._wrist_times, now_ns - SENSING_LIMIT_NS) : until]:
            placed.put(sample)
        found = placed.hands_at(now_ns)
        return HandTracks(t_ns, found.hands if found is not None else ())

    def felt_between(self, after_ns: int, until_ns: int) -> list[BodySample]:
        """What the inertial sensors felt, by the scenario's time."""
        begin = bisect_right(self._felt_times, self._from_ns + after_ns)
        end = bisect_right(self._felt_times, self._from_ns + until_ns)
        moved = self.felt[begin:end]
        return [replace(sample, captured_ns=sample.captured_ns - self._from_ns) for sample in moved]


class SceneLess(FeatureAssembler):
    """The feature chain of somebody whose scene nobody filmed: the modality is missing."""

    def update(
        self, frame: CameraFrame | None, gaze: GazeSample | None, hands: HandTracks | None, now_ns: int
    ) -> FeatureVector:
        return super().update(None, gaze, hands, now_ns)


class Video:
    """A video file by time; read forwards, opened again for what lies behind."""

    def __init__(self, path: Path) -> None:
        """Raises InputError for a file that is no video."""
        self._path = path
        if not path.is_file():
            raise InputError(f"video {path}: no such file")
        self._open()
        self._fps = float(self._capture.get(cv2.CAP_PROP_FPS))
        self._count = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        if not self._capture.isOpened() or self._fps <= 0.0 or self._count <= 0:
            raise InputError(f"video {path}: not a whole video; copy or export it again")

    @property
    def duration_ns(self) -> int:
        return round(self._count / self._fps * 1e9)

    def at(self, t_ns: int) -> tuple[int, NDArray[np.uint8]]:
        """Number and content of the picture shown at `t_ns`; the last one after the end.

        Raises InputError for a picture that cannot be read.
        """
        wanted = min(max(0, int(t_ns * 1e-9 * self._fps + 1e-6)), self._count - 1)
        if wanted < self._index:
            self._open()
        while self._index < wanted:
            read, bgr = self._capture.read()
            if not read:
                raise InputError(
                    f"video {self._path}: picture {self._index + 2} of {self._count} cannot be read; "
                    "it is truncated, copy or export it again"
                )
            self._index += 1
            if self._index == wanted:
                self._rgb = np.ascontiguousarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)).astype(np.uint8, copy=False)
        return wanted, self._rgb

    def _open(self) -> None:
        self._capture = cv2.VideoCapture(str(self._path))
        self._index = -1
        self._rgb = _GREY


class PackAssembler(FeatureAssembler):
    """Features of a pack in place of what is computed; a modality whose sensor is silent is missing as it would be."""

    def __init__(self, session: Session, duration_ns: int) -> None:
        """Raises InputError for a pack that is absent, unreadable or too short."""
        super().__init__()
        assert session.features is not None
        try:
            self._values, self._valid = read_pack(Path(session.features))
        except BadZipFile:
            raise InputError(f"{session.features}: not a whole feature pack; extract it again") from None
        self._from_ns = session.from_
        long_enough(f"features {session.features}", len(self._values) * STEP_NS, session.from_, duration_ns)

    def update(
        self, frame: CameraFrame | None, gaze: GazeSample | None, hands: HandTracks | None, now_ns: int
    ) -> FeatureVector:
        """The pack's step at `now_ns`, with the stamps of the sensors that ran."""
        seen = super().update(frame, gaze, hands, now_ns)
        step = min(max(0, (self._from_ns + now_ns) // STEP_NS), len(self._values) - 1)
        values, valid = self._values[step].copy(), self._valid[step].copy()
        for modality in Modality:
            if not seen.valid[modality]:
                drop_modality(values, valid, modality)
        return replace(seen, values=values, valid=(bool(valid[0]), bool(valid[1]), bool(valid[2])))


def long_enough(name: str, has_ns: int, from_ns: int, duration_ns: int) -> None:
    """Raises InputError for a session that ends before the scenario."""
    # The last picture or sample of a recording stands until the next would have come.
    if has_ns + STEP_NS < from_ns + duration_ns:
        raise InputError(
            f"{name}: lasts {has_ns / 1e9:.2f} s, the scenario needs {(from_ns + duration_ns) / 1e9:.2f} s of it; "
            "make `duration` or `from` shorter"
        )
