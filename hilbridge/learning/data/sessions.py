"""Real sessions as 25 Hz feature streams, windows before every annotated onset, and what had to be discarded.

Works with whichever modalities are there: a BeGaze export gives gaze, a video scene and, with a detector, hands, and a
feature pack (`feature_packs/SESSION.npz` with `values` (N, D) and `valid` (N, 3) at 25 Hz, made by `hilbridge data pack`)
whatever it was made from; it goes before the other two.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import RATE_HZ, STEP_NS, D
from hilbridge.features.packs import file_hash, pack_made_from, read_pack
from hilbridge.intent.predictor import MIN_USABLE_SHARE
from hilbridge.learning.data.egtea import GAZE, Action, DatasetError
from hilbridge.learning.data.iassistadl import recording_features, recording_folders
from hilbridge.learning.data.labelled import Spanned, labelled_stream
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.windows import STEPS
from hilbridge.records import CameraFrame, GazeSample, HandTracks, StampSource
from hilbridge.sensors.begaze import BegazeRecording, read_begaze
from hilbridge.verbs import VERBS

BEGAZE_FPS = 24.0
LEAD_STEPS = 13  # 0.52 s: with onsets rounded to 40 ms a window never comes closer than the paper's 0.5 s
Detector = Callable[[CameraFrame], HandTracks]
PACKS = Path("feature_packs")
VIDEO_FOLDERS = ("videos", "video", "raw_videos")
VIDEO_SUFFIXES = (".mp4", ".avi", ".mkv")


@dataclass(frozen=True, slots=True)
class Discards:
    """Annotated onsets and what became of them."""

    onsets: int = 0
    kept: int = 0
    too_early: int = 0
    after_the_recording: int = 0
    too_few_valid: int = 0

    def __add__(self, other: Discards) -> Discards:
        return Discards(
            self.onsets + other.onsets,
            self.kept + other.kept,
            self.too_early + other.too_early,
            self.after_the_recording + other.after_the_recording,
            self.too_few_valid + other.too_few_valid,
        )


def gaze_path(root: Path, session: str) -> Path:
    """Where the package has a session's gaze."""
    return root / GAZE / f"{session}.txt"


def video_path(root: Path, session: str) -> Path | None:
    """A session's video, or None."""
    places = (root / folder / f"{session}{suffix}" for folder in VIDEO_FOLDERS for suffix in VIDEO_SUFFIXES)
    return next((place for place in places if place.is_file()), None)


def recorded_sessions(root: Path) -> list[str]:
    """Names of all sessions of which anything but annotations is there: a pack, gaze, a video, or an iAssistADL folder."""
    names = {path.stem for path in (root / GAZE).glob("*.txt")} | {path.stem for path in (root / PACKS).glob("*.npz")}
    names |= set(recording_folders(root))
    for folder in VIDEO_FOLDERS:
        names |= {path.stem for path in (root / folder).glob("*") if path.suffix in VIDEO_SUFFIXES}
    return sorted(names)


def load_features(
    root: Path, session: str, detector: Detector | None = None
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """One session's features at 25 Hz: its pack, or what its gaze and video give.

    Raises DatasetError for a session of which nothing is there, or a file that is not what it should be.
    """
    pack = root / PACKS / f"{session}.npz"
    gaze, video = gaze_path(root, session), video_path(root, session)
    if pack.is_file():
        values, valid = read_pack(pack)
        # The gaze file is checked at every reading; a video takes too long for that.
        digest = pack_made_from(pack).get(gaze.name)
        if digest is not None and gaze.is_file() and file_hash(gaze) != digest:
            raise DatasetError(
                f"{pack}: made from another {gaze.name} than is there now; delete it and run `data pack`"
            )
        return values, valid
    if (folder := recording_folders(root).get(session)) is not None:
        return recording_features(folder)
    recording = read_begaze(gaze) if gaze.is_file() else None
    if recording is None and video is None:
        raise DatasetError(f"{session}: no pack, gaze or video under {root}; give the session's files or leave it out")
    steps = 0 if recording is None else int(recording.video_s()[-1] * RATE_HZ + 1e-9) + 1
    return session_features(steps if video is None else max(steps, _video_steps(video)), recording, video, detector)


def _video_steps(video: Path) -> int:
    capture = cv2.VideoCapture(str(video))
    try:
        if not capture.isOpened():
            raise DatasetError(f"{video}: cannot be opened as a video; check the file or leave the videos out")
        count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        if count <= 0:  # WebM and Matroska may not say: then the pictures are counted
            count = 0
            while capture.grab():
                count += 1
        if count == 0:
            raise DatasetError(f"{video}: holds no picture that can be decoded; check the file or leave the videos out")
        return int(count * RATE_HZ // _frames_per_second(capture))
    finally:
        capture.release()


def _frames_per_second(capture: cv2.VideoCapture) -> float:
    """The package's videos have 24, by which BeGaze counts (and 23.976 means the same frames); others go by their own."""
    claimed = float(capture.get(cv2.CAP_PROP_FPS))
    return claimed if 1.0 <= claimed <= 240.0 and abs(claimed - BEGAZE_FPS) > 0.5 else BEGAZE_FPS


def gaze_steps(recording: BegazeRecording, steps: int) -> list[GazeSample]:
    """The newest sample at or before each 25 Hz step of the video's own time (frame / frame rate)."""
    # Samples share frames (30 Hz against 24): within one frame the later sample is the newer.
    index = np.searchsorted(recording.video_s(), np.arange(steps) / RATE_HZ + 1e-9, side="right") - 1
    made = []
    seen_s = recording.video_s()
    for step, position in enumerate(index):
        if position < 0:
            made.append(GazeSample(step * STEP_NS, 0.0, 0.0, False))
            continue
        # The stamp tells samples apart and is never later than the step; the video's frame is the finest true time.
        stamp = min(step * STEP_NS, round(seen_s[position] * 1e9) + int(position) % 2)
        made.append(
            GazeSample(
                stamp,
                float(recording.x[position]),
                float(recording.y[position]),
                bool(recording.valid[position]),
                StampSource.HARDWARE,
            )
        )
    return made


def session_features(
    steps: int,
    recording: BegazeRecording | None = None,
    video: Path | None = None,
    detector: Detector | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """One session through the project's own feature chain: (N, D) values and (N, 3) valid at 25 Hz."""
    assembler = FeatureAssembler()
    gaze = None if recording is None else gaze_steps(recording, steps)
    frames = None if video is None else _frames(video)
    values = np.zeros((steps, D), dtype=np.float32)
    valid = np.zeros((steps, 3), dtype=bool)
    frame: CameraFrame | None = None
    upcoming = None if frames is None else next(frames, None)
    hands: HandTracks | None = None
    for step in range(steps):
        now_ns = step * STEP_NS
        while upcoming is not None and frames is not None and upcoming.captured_ns <= now_ns:
            frame = upcoming
            upcoming = next(frames, None)
            hands = None if detector is None else detector(frame)
        vector = assembler.update(frame, None if gaze is None else gaze[step], hands, now_ns)
        values[step], valid[step] = vector.values, vector.valid
    return values, valid


def _frames(video: Path) -> Iterator[CameraFrame]:
    capture = cv2.VideoCapture(str(video))
    try:
        if not capture.isOpened():
            raise DatasetError(f"{video}: cannot be opened as a video; check the file or leave the videos out")
        number, per_second = 0, _frames_per_second(capture)
        while True:
            read, bgr = capture.read()
            if not read:
                return
            rgb = np.ascontiguousarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)).astype(np.uint8, copy=False)
            yield CameraFrame(round(number / per_second * 1e9), rgb, number, StampSource.HARDWARE)
            number += 1
    finally:
        capture.release()


def session_stream(
    subject: int,
    actions: Sequence[Action],
    values: NDArray[np.float32],
    valid: NDArray[np.bool_],
    verbs: int = len(VERBS),
) -> tuple[Stream, NDArray[np.int64], Discards]:
    """A session's stream, the ends of its windows (2 s, ending 0.5 s before each onset) and the discards.

    Labels are laid over it by the rule of `labelled_stream`, gaps between the annotated actions being idle.
    """
    steps = len(values)
    spans = [Spanned(action.start_ms, action.end_ms, action.label) for action in actions]
    stream = labelled_stream(subject, spans, values, valid, gaps_are_idle=True, verbs=verbs)
    onsets = np.array([round(action.start_ms * RATE_HZ / 1000.0) for action in actions])
    labels = np.array([action.label for action in actions])
    ends = onsets - LEAD_STEPS
    too_early = ends < STEPS - 1
    too_late = ends >= steps
    usable = np.concatenate([[0], np.cumsum(valid.any(axis=1))])
    inside = np.clip(ends, STEPS - 1, max(STEPS - 1, steps - 1))
    enough = usable[np.minimum(inside + 1, steps)] - usable[inside + 1 - STEPS] >= MIN_USABLE_SHARE * STEPS
    keep = ~too_early & ~too_late & enough
    # The window belongs to this onset's action even when another begins in the last half second.
    stream.label[ends[keep]] = labels[keep]
    counts = Discards(
        len(onsets),
        int(keep.sum()),
        int(too_early.sum()),
        int((too_late & ~too_early).sum()),
        int((~too_early & ~too_late & ~enough).sum()),
    )
    return stream, ends[keep], counts


def folds(subjects: Sequence[str], count: int, held: int = 4) -> list[Mapping[str, frozenset[str]]]:
    """Subject-disjoint folds: `held` subjects to test, the next `held` to validate, the rest to train.

    With 32 subjects: count 3 is the paper's 24/4/4, count 8 tests everybody exactly once. The order is fixed by a seed,
    so that recipes and subjects do not line up.
    """
    order = [str(name) for name in np.random.default_rng(6).permutation(sorted(subjects))]
    if len(order) < 3 * held or count * held > len(order):
        raise ValueError(
            f"{len(order)} subjects are too few for {count} folds of {held} test and {held} validation subjects"
        )
    made: list[Mapping[str, frozenset[str]]] = []
    for fold in range(count):
        turned = order[fold * held :] + order[: fold * held]
        made.append(
            {
                "test": frozenset(turned[:held]),
                "validation": frozenset(turned[held : 2 * held]),
                "train": frozenset(turned[2 * held :]),
            }
        )
    return made
