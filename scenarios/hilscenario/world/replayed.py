"""The recording of an earlier run in the wearer's place: its beliefs, its features, or its pictures, gaze and hands.

All are functions of the scenario's time, so that lockstep runs repeat to the byte.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError
from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import STEP_NS, D, drop_modality
from hilbridge.limits import SENSING_LIMIT_NS
from hilbridge.observe.keeping.pictures import camera_frame, scene_frame
from hilbridge.observe.reading import read_recording
from hilbridge.records import CameraFrame, FeatureVector, GazeSample, HandTracks, IntentEstimate, Modality
from hilbridge.rows import (
    BeliefRow,
    FeaturesRow,
    FixedRow,
    GazeRow,
    HandsRow,
    ImageRow,
    Row,
    SceneRow,
    TickRow,
    estimate_of,
    feature_vector,
    gaze_sample,
    hand_tracks,
)
from hilscenario.format.schema import Scenario, Session
from hilscenario.world.recorded import Filmed, PackAssembler, Person, SceneLess, Unlabelled, Unseen, Worn, long_enough


def _rows(session: Session, *kinds: type[FixedRow]) -> tuple[list[Row], int]:
    """Rows of these kinds, and the time of the first tick, which is where the session begins. Raises InputError."""
    assert session.recording is not None
    rows = list(read_recording(Path(session.recording), (TickRow.topic, *(kind.topic for kind in kinds))))
    ticks = [row for row in rows if isinstance(row, TickRow)]
    if not ticks:
        raise InputError(
            f"recording {session.recording}: has no /tick rows; name the recording of a run or of a scenario"
        )
    return rows, ticks[0].time_ns


class Believed:
    """Gives the estimates of an earlier run at the same times, whatever the sensors see."""

    def __init__(self, session: Session, duration_ns: int, bundle_id: int, start_ns: int = 0) -> None:
        """Raises InputError for a file that is absent, cut off, too short, or not the recording of a run."""
        rows, begin_ns = _rows(session, BeliefRow)
        self._times: list[int] = []
        self._beliefs: list[IntentEstimate | None] = []
        known: BeliefRow | None = None
        for row in rows:
            if isinstance(row, BeliefRow):
                known = row
            elif isinstance(row, TickRow) and row.new_features:
                self._times.append(row.time_ns - begin_ns)
                made = known is not None and known.time_ns == row.time_ns
                self._beliefs.append(estimate_of(known) if made and known is not None else None)
        long_enough(f"recording {session.recording}", _last_ns(rows) - begin_ns + STEP_NS, session.from_, duration_ns)
        self._offset_ns = session.from_ - start_ns
        self._bundle_id = bundle_id

    def step(self, vector: FeatureVector, produced_ns: int) -> IntentEstimate | None:
        """The estimate at that time; None where there was none yet."""
        found = bisect_right(self._times, produced_ns + self._offset_ns) - 1
        belief = self._beliefs[found] if found >= 0 else None
        if belief is None:
            return None
        return replace(
            belief,
            oldest_input_ns=vector.oldest_input_ns,
            produced_ns=produced_ns,
            bundle_id=self._bundle_id,
            valid=vector.valid,
        )

    def reset(self) -> None: ...


class RecordedAssembler(FeatureAssembler):
    """Features of a recording in place of what is computed; a modality whose sensor is silent is missing as it would be."""

    def __init__(self, session: Session, duration_ns: int) -> None:
        """Raises InputError for a recording without features, or too short."""
        super().__init__()
        rows, begin_ns = _rows(session, FeaturesRow)
        self._rows = sorted((row for row in rows if isinstance(row, FeaturesRow)), key=lambda row: row.captured_ns)
        _some(self._rows, session, "features")
        long_enough(f"recording {session.recording}", _last_ns(rows) - begin_ns + STEP_NS, session.from_, duration_ns)
        self._times = [row.captured_ns - begin_ns for row in self._rows]
        self._from_ns = session.from_

    def update(
        self, frame: CameraFrame | None, gaze: GazeSample | None, hands: HandTracks | None, now_ns: int
    ) -> FeatureVector:
        """The recording's features of `now_ns`, with the stamps of the sensors that ran."""
        seen = super().update(frame, gaze, hands, now_ns)
        values, valid = self._at(self._from_ns + now_ns)
        for modality in Modality:
            if not seen.valid[modality]:
                drop_modality(values, valid, modality)
        return replace(seen, values=values, valid=(bool(valid[0]), bool(valid[1]), bool(valid[2])))

    def _at(self, when_ns: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        found = bisect_right(self._times, when_ns) - 1
        if found < 0 or when_ns - self._times[found] > SENSING_LIMIT_NS:  # nothing was seen then, either
            return np.zeros(D, np.float32), np.zeros(len(Modality), np.bool_)
        vector = feature_vector(self._rows[found])
        return vector.values, np.array(vector.valid)


class Relived(Unlabelled):
    """What the sensors of an earlier run gave: the pictures as stored, gaze and hands as they were."""

    def __init__(self, session: Session, duration_ns: int) -> None:
        """Raises InputError for a recording without pictures or gaze, or too short."""
        rows, begin_ns = _rows(session, ImageRow, SceneRow, GazeRow, HandsRow)
        self._offset_ns = begin_ns + session.from_
        self._name = f"recording {session.recording}"
        until_ns = self._offset_ns + duration_ns
        looked = [row for row in rows if isinstance(row, ImageRow | SceneRow) and row.captured_ns <= until_ns]
        exact = [row for row in looked if isinstance(row, SceneRow)]  # unchanged by JPEG
        self._pictures = sorted(exact or looked, key=lambda row: row.captured_ns)
        self._gazes = sorted((row for row in rows if isinstance(row, GazeRow)), key=lambda row: row.captured_ns)
        self._hands = sorted((row for row in rows if isinstance(row, HandsRow)), key=lambda row: row.captured_ns)
        _some(self._pictures, session, "pictures")
        _some(self._gazes, session, "gaze")
        long_enough(self._name, _last_ns(rows) - begin_ns + STEP_NS, session.from_, duration_ns)
        self._picture_times = [row.captured_ns for row in self._pictures]
        self._gaze_times = [row.captured_ns for row in self._gazes]
        self._hands_times = [row.captured_ns for row in self._hands]
        self._decoded: tuple[int, CameraFrame] | None = None

    def frame(self, t_ns: int) -> CameraFrame:
        """The picture of that moment. Raises InputError for one that cannot be read."""
        found = max(0, bisect_right(self._picture_times, t_ns + self._offset_ns) - 1)
        if self._decoded is None or self._decoded[0] != found:
            try:
                row = self._pictures[found]
                self._decoded = found, scene_frame(row) if isinstance(row, SceneRow) else camera_frame(row)
            except ValueError as error:
                raise InputError(f"{self._name}: {error}; record it again") from None
        return replace(self._decoded[1], captured_ns=t_ns)

    def gaze(self, t_ns: int) -> GazeSample:
        """The point of regard of that moment."""
        found = max(0, bisect_right(self._gaze_times, t_ns + self._offset_ns) - 1)
        return replace(gaze_sample(self._gazes[found]), captured_ns=t_ns)

    def hands(self, t_ns: int) -> HandTracks:
        """The hands as they were found then; none where nobody looked."""
        found = bisect_right(self._hands_times, t_ns + self._offset_ns) - 1
        return HandTracks(t_ns, hand_tracks(self._hands[found]).hands if found >= 0 else ())


def _last_ns(rows: Sequence[Row]) -> int:
    return max(row.time_ns for row in rows)


def _some(rows: Sequence[Row], session: Session, what: str) -> None:
    if not rows:
        raise InputError(f"recording {session.recording}: holds no {what}; replay its `beliefs`, or record it anew")


def recorded_person(scenario: Scenario) -> Person | None:
    """Who stands before the sensors, where that is a recorded session; else None. Raises InputError."""
    session = scenario.intent
    if not isinstance(session, Session):
        return None
    if session.folder is not None:
        return Worn(session, scenario.duration)
    if session.video is not None:
        return Filmed(session, scenario.duration)
    if session.recording is not None and session.replay == "beliefs":
        return None
    return Relived(session, scenario.duration) if session.replay == "sensors" else Unseen()


def make_assembler(scenario: Scenario) -> FeatureAssembler:
    """The feature chain, or recorded features in its place. Raises InputError."""
    session = scenario.intent
    if isinstance(session, Session) and session.folder is not None and session.video is None:
        return SceneLess()
    if isinstance(session, Session) and session.features is not None:
        return PackAssembler(session, scenario.duration)
    if isinstance(session, Session) and session.recording is not None and session.replay == "features":
        return RecordedAssembler(session, scenario.duration)
    return FeatureAssembler()
