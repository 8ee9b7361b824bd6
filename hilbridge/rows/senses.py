"""Rows of what the sensors gave and what was made of it. `time_ns` is when the bridge had it, `captured_ns` when it was."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hilbridge.records import BodySample, FeatureVector, GazeSample, Hand, HandTracks, StampSource
from hilbridge.rows.fields import Base64, finite, number


@dataclass(frozen=True, slots=True)
class Stamp:
    """A time as Foxglove has it."""

    sec: int
    nsec: int


@dataclass(frozen=True, slots=True)
class ImageRow:
    """A picture of the head camera as JPEG, a `foxglove.CompressedImage`."""

    topic: ClassVar[str] = "/camera"
    schema: ClassVar[str] = "foxglove.CompressedImage"

    time_ns: int
    captured_ns: int
    timestamp: Stamp
    """`captured_ns` again, as viewers want it."""
    frame_id: str
    data: Base64
    format: str
    sequence: int
    width_px: int
    """Of the picture as it came; what is stored may be smaller."""
    height_px: int
    stamp: StampSource = StampSource.ARRIVAL


@dataclass(frozen=True, slots=True)
class SceneRow:
    """The few pixels of a picture that scene features are made of, as they were: JPEG would change the features."""

    topic: ClassVar[str] = "/scene"

    time_ns: int
    captured_ns: int
    sequence: int
    width_px: int
    height_px: int
    rgb: Base64
    """Row by row, three bytes a pixel."""


@dataclass(frozen=True, slots=True)
class GazeRow:
    """A point of regard, as the eye tracker gave it. A coordinate that was no number is absent."""

    topic: ClassVar[str] = "/gaze"

    time_ns: int
    captured_ns: int
    valid: bool
    x: float | None = None
    """0..1 of the picture from the left."""
    y: float | None = None
    """0..1 from the top."""
    stamp: StampSource = StampSource.ARRIVAL


@dataclass(frozen=True, slots=True)
class InertialRow:
    """What an inertial sensor felt, gravity included."""

    topic: ClassVar[str] = "/inertial"

    time_ns: int
    captured_ns: int
    sensor: str
    x: float
    """In m/s^2, along the sensor's own axes."""
    y: float
    z: float
    valid: bool = True
    stamp: StampSource = StampSource.ARRIVAL


@dataclass(frozen=True, slots=True)
class SkeletonRow:
    """Where a joint of the skeleton was."""

    topic: ClassVar[str] = "/skeleton"

    time_ns: int
    captured_ns: int
    sensor: str
    """Which joint."""
    x: float
    """In metres, as the skeleton's own camera has it."""
    y: float
    z: float
    valid: bool = True
    stamp: StampSource = StampSource.ARRIVAL


@dataclass(frozen=True, slots=True)
class HandFound:
    """One hand as detected: palm centre, score, and the landmarks x, y, z one after the other where there are any."""

    x: float | None = None
    y: float | None = None
    score: float | None = None
    landmarks: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class HandsRow:
    """All hands that were found in one picture."""

    topic: ClassVar[str] = "/hands"

    time_ns: int
    captured_ns: int
    count: int
    hands: tuple[HandFound, ...] = ()


@dataclass(frozen=True, slots=True)
class FeaturesRow:
    """The features of one picture, and what they were made of. Numbers are float32, written so that they come back."""

    topic: ClassVar[str] = "/features"

    time_ns: int
    captured_ns: int
    """The moment that they are of: the picture's."""
    oldest_input_ns: int
    gaze_valid: bool
    hands_valid: bool
    scene_valid: bool
    values: tuple[float, ...]
    """In the order of docs/features.md, raw."""
    gaze_ns: int | None = None
    """`captured_ns` of the gaze sample handed in with the picture."""
    hands_ns: int | None = None
    """`captured_ns` of the hands handed in with it."""
    sequence: int | None = None
    """The picture's number."""


@dataclass(frozen=True, slots=True)
class SourceAccount:
    """What became of every value of one source."""

    received: int
    used: int
    overwritten: int
    """Replaced by a newer one before anybody looked."""
    failed: int
    pending: int
    with_hands: int | None = None
    """Pictures in which a hand was found."""


@dataclass(frozen=True, slots=True)
class SensorsRow:
    """Once a second: the account of every source."""

    topic: ClassVar[str] = "/sensors"

    time_ns: int
    sources: dict[str, SourceAccount]


@dataclass(frozen=True, slots=True)
class ClockRow:
    """Once a second: how the clock of a device that has its own stands to this computer's."""

    topic: ClassVar[str] = "/clocks"

    time_ns: int
    device: str
    offset_ns: int
    """This computer's monotonic clock minus the device's, at `time_ns`."""
    drift_ppm: float
    """How much faster than the device's this clock runs."""
    residual_ms: float
    """What the quickest probes leave over of it, root mean square."""
    bound_ms: float
    """How far a stamp that was carried over may be off; above 10 the modality is masked."""
    probes: int
    steps: int
    """How often the device's clock was set."""


def image_stamp(captured_ns: int) -> Stamp:
    """A time in the two parts that Foxglove has."""
    return Stamp(*divmod(captured_ns, 1_000_000_000))


def gaze_row(sample: GazeSample, now_ns: int) -> GazeRow:
    """A sample as it came in."""
    return GazeRow(now_ns, sample.captured_ns, sample.valid, finite(sample.x), finite(sample.y), sample.stamp)


def body_row(kind: type[InertialRow] | type[SkeletonRow], sample: BodySample, now_ns: int) -> InertialRow | SkeletonRow:
    """A sample as it came in."""
    place = sample.x, sample.y, sample.z
    return kind(now_ns, sample.captured_ns, sample.sensor, *place, sample.valid, sample.stamp)


def gaze_sample(row: GazeRow) -> GazeSample:
    """The sample of a row."""
    return GazeSample(row.captured_ns, number(row.x), number(row.y), row.valid, row.stamp)


def hands_row(tracks: HandTracks, now_ns: int) -> HandsRow:
    """What a detector gave."""
    found = [HandFound(finite(one.x), finite(one.y), finite(one.score), one.landmarks) for one in tracks.hands]
    return HandsRow(now_ns, tracks.captured_ns, len(found), tuple(found))


def hand_tracks(row: HandsRow) -> HandTracks:
    """The hands of a row."""
    hands = [Hand(number(one.x), number(one.y), number(one.score), one.landmarks) for one in row.hands]
    return HandTracks(row.captured_ns, tuple(hands))


@dataclass(frozen=True, slots=True)
class Look:
    """One step of the vision worker: what it was given, and the features that it made, which were `ready_ns` at hand."""

    ready_ns: int
    vector: FeatureVector
    sequence: int
    gaze: GazeSample | None
    hands: HandTracks | None


def features_row(look: Look) -> FeaturesRow:
    """Features as they were made. Their time is before that of any tick that has them."""
    vector = look.vector
    return FeaturesRow(
        look.ready_ns,
        vector.captured_ns,
        vector.oldest_input_ns,
        *vector.valid,
        tuple(vector.values.tolist()),
        None if look.gaze is None else look.gaze.captured_ns,
        None if look.hands is None else look.hands.captured_ns,
        look.sequence,
    )


def feature_vector(row: FeaturesRow) -> FeatureVector:
    """The features of a row, bit for bit."""
    valid = (row.gaze_valid, row.hands_valid, row.scene_valid)
    return FeatureVector(row.oldest_input_ns, row.captured_ns, np.array(row.values, np.float32), valid)
