"""What a recording gives to be decided anew: its ticks, each with the features that it had.

Features are the recorded ones, or made anew from the recorded pictures, gaze and hands by the project's own chain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from hilbridge.features.assembler import FeatureAssembler
from hilbridge.records import CameraFrame, FeatureVector, HandTracks
from hilbridge.rows import (
    BeliefRow,
    FeaturesRow,
    GazeRow,
    HandsRow,
    ImageRow,
    Row,
    SceneRow,
    TickRow,
    feature_vector,
    gaze_sample,
    hand_tracks,
)

_KEPT_NS = 3_000_000_000  # features that no tick took, and inputs that no features took


class Source(StrEnum):
    """Where a replay starts."""

    FEATURES = "features"
    SENSORS = "gaze+video"
    BELIEFS = "beliefs"


TOPICS: dict[Source, tuple[str, ...]] = {
    Source.FEATURES: (FeaturesRow.topic,),
    Source.SENSORS: (FeaturesRow.topic, ImageRow.topic, SceneRow.topic, GazeRow.topic, HandsRow.topic),
    Source.BELIEFS: (FeaturesRow.topic, BeliefRow.topic),
}


class FindsHands(Protocol):
    """What sensors.hands.HandDetector provides."""

    def detect(self, frame: CameraFrame) -> HandTracks: ...


@dataclass(slots=True)
class Made:
    """How features came to be: `of_scene` anew of the very pixels that they were made of; `of_jpeg` of a picture that is
    nearly what was seen; `as_recorded` where neither is in the recording.

    lacking: ticks whose features the recording does not have.
    """

    of_scene: int = 0
    of_jpeg: int = 0
    as_recorded: int = 0
    lacking: int = 0


@dataclass(frozen=True, slots=True)
class RecordedTick:
    """One tick to decide anew, with the features that were new in it, and what was believed then."""

    row: TickRow
    vector: FeatureVector | None
    belief: BeliefRow | None


def recorded_ticks(rows: Iterable[Row], looks: Looks, made: Made) -> Iterator[RecordedTick]:
    """The ticks in their order. Raises what `rows` and `looks` raise."""
    belief: BeliefRow | None = None
    for row in rows:
        if isinstance(row, BeliefRow):
            belief = row
        elif isinstance(row, TickRow):
            vector = looks.of(row)
            made.lacking += row.new_features and vector is None
            yield RecordedTick(row, vector, belief if belief is not None and belief.time_ns == row.time_ns else None)
        else:
            looks.take(row)


class Looks(Protocol):
    """Takes in rows, gives the features of a tick."""

    def take(self, row: Row) -> None: ...

    def of(self, tick: TickRow) -> FeatureVector | None: ...


class RecordedLooks:
    """Features as they were recorded."""

    def __init__(self) -> None:
        self._rows: dict[int, FeaturesRow] = {}

    def take(self, row: Row) -> None:
        """Keep features until their tick comes."""
        if isinstance(row, FeaturesRow):
            self._rows[row.captured_ns] = row

    def of(self, tick: TickRow) -> FeatureVector | None:
        """The features that this tick had; None where it had no new ones, and where they are lacking."""
        if tick.features_ns is None:
            return None
        found = self._rows.pop(tick.features_ns, None)
        self._rows = {when: row for when, row in self._rows.items() if when > tick.features_ns - _KEPT_NS}
        return None if found is None else feature_vector(found)


@dataclass(frozen=True, slots=True)
class Eyes:
    """How pictures are read. `detector` finds hands in them; None: hands as they were recorded."""

    of_scene: Callable[[SceneRow], CameraFrame]
    of_picture: Callable[[ImageRow], CameraFrame]
    detector: FindsHands | None = None


class AnewLooks:
    """Features made anew of pictures, gaze and hands, each look with just the inputs that it had then."""

    def __init__(self, made: Made, eyes: Eyes) -> None:
        self._made, self._eyes = made, eyes
        self._assembler = FeatureAssembler()
        self._waiting: list[FeaturesRow] = []
        self._inputs: dict[tuple[type[Row], int], Row] = {}
        self._vectors: dict[int, FeatureVector] = {}

    def take(self, row: Row) -> None:
        """Keep what came in."""
        if isinstance(row, FeaturesRow):
            self._waiting.append(row)
        elif isinstance(row, ImageRow | SceneRow | GazeRow | HandsRow):
            self._inputs[type(row), row.captured_ns] = row

    def of(self, tick: TickRow) -> FeatureVector | None:
        """The features of this tick, made anew."""
        if tick.first:
            self._assembler.reset()
        for row in self._waiting:
            self._vectors[row.captured_ns] = self._look(row)
        self._waiting.clear()
        if tick.features_ns is None:
            return None
        found = self._vectors.pop(tick.features_ns, None)
        old_ns = tick.features_ns - _KEPT_NS
        self._vectors = {when: vector for when, vector in self._vectors.items() if when > old_ns}
        self._inputs = {key: row for key, row in self._inputs.items() if key[1] > old_ns}
        return found

    def _look(self, row: FeaturesRow) -> FeatureVector:
        scene, picture = (self._inputs.get((kind, row.captured_ns)) for kind in (SceneRow, ImageRow))
        if isinstance(scene, SceneRow):
            self._made.of_scene += 1
            frame = self._eyes.of_scene(scene)
        elif isinstance(picture, ImageRow):
            self._made.of_jpeg += 1
            frame = self._eyes.of_picture(picture)
        else:
            self._made.as_recorded += 1
            return feature_vector(row)
        gaze = None if row.gaze_ns is None else self._inputs.get((GazeRow, row.gaze_ns))
        sample = gaze_sample(gaze) if isinstance(gaze, GazeRow) else None
        return self._assembler.update(frame, sample, self._hands(row, picture), row.captured_ns)

    def _hands(self, row: FeaturesRow, picture: Row | None) -> HandTracks | None:
        if row.hands_ns is None:
            return None
        found = self._inputs.get((HandsRow, row.hands_ns))
        wrists = isinstance(found, HandsRow) and any(not hand.landmarks for hand in found.hands)
        if self._eyes.detector is not None and isinstance(picture, ImageRow) and not wrists:
            return self._eyes.detector.detect(self._eyes.of_picture(picture))
        return hand_tracks(found) if isinstance(found, HandsRow) else None
