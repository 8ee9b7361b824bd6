"""replay.source: features made anew of what was recorded are the features that were made then."""

from __future__ import annotations

from dataclasses import replace

from hilbridge.features.assembler import FeatureAssembler
from hilbridge.observe.keeping.pictures import PictureFormat, camera_frame, image_row, scene_frame, scene_row
from hilbridge.records import Action, CameraFrame, FeatureVector, HandTracks, HoldReason
from hilbridge.replay.source import AnewLooks, Eyes, Made, recorded_ticks
from hilbridge.rows import (
    FeaturesRow,
    HandsRow,
    ImageRow,
    Look,
    Row,
    SceneRow,
    TickRow,
    decode,
    encode,
    features_row,
    gaze_row,
    hands_row,
)
from hilbridge.wearer.person import Wearer

STEP = 40_000_000


def session(steps: int = 60) -> tuple[list[Row], list[FeatureVector]]:
    """Rows as a live run writes them, through the encoder and back, and the features that were made."""
    wearer, assembler = Wearer(4, width_px=320, height_px=240), FeatureAssembler()
    rows: list[Row] = []
    vectors = []
    for step in range(1, steps + 1):
        when_ns = step * STEP
        frame, gaze, hands = wearer.frame(when_ns), wearer.gaze(when_ns - 7), wearer.hands(when_ns)
        sample = gaze if step % 7 else None  # not every picture has a new sample
        vector = assembler.update(frame, sample, hands, when_ns)
        vectors.append(vector)
        ready_ns = when_ns + 5_000_000
        rows += [
            gaze_row(gaze, when_ns),
            hands_row(hands, ready_ns),
            features_row(Look(ready_ns, vector, step, sample, hands)),
        ]
        rows += [scene_row(frame, ready_ns), image_row(frame, PictureFormat(), ready_ns)]
        if step % 5:  # some features no tick takes
            rows.append(tick(when_ns + 8_000_000, when_ns, first=step == 1))
    return [decode(row.topic, row.time_ns, encode(row)) for row in rows], vectors


def as_by_a_detector(row: Row) -> Row:
    if not isinstance(row, HandsRow):
        return row
    return replace(row, hands=tuple(replace(hand, landmarks=(0.5, 0.5, 0.0)) for hand in row.hands))


def tick(now_ns: int, features_ns: int, *, first: bool) -> TickRow:
    return TickRow(now_ns, Action.HOLD, HoldReason.STALE, 0.0, new_features=True, features_ns=features_ns, first=first)


def same(one: FeatureVector | None, other: FeatureVector) -> bool:
    return (
        one is not None
        and one.values.tobytes() == other.values.tobytes()
        and (one.oldest_input_ns, one.captured_ns, one.valid) == (other.oldest_input_ns, other.captured_ns, other.valid)
    )


def anew(rows: list[Row], made: Made, eyes: Eyes | None = None) -> list[FeatureVector | None]:
    looks = AnewLooks(made, eyes or Eyes(scene_frame, camera_frame))
    return [one.vector for one in recorded_ticks(rows, looks, made)]


def wanted(vectors: list[FeatureVector]) -> list[FeatureVector]:
    return [vector for step, vector in enumerate(vectors, 1) if step % 5]


def test_of_the_pixels_that_were_seen_features_are_the_same_to_the_last_bit() -> None:
    rows, vectors = session()
    made = Made()
    found = anew(rows, made)
    assert all(same(one, other) for one, other in zip(found, wanted(vectors), strict=True))
    assert made == Made(of_scene=59, of_jpeg=0, as_recorded=0, lacking=0)  # the last has no tick after it


def test_of_jpeg_they_are_nearly_the_same() -> None:
    rows, vectors = session()
    made = Made()
    found = anew([row for row in rows if not isinstance(row, SceneRow)], made)
    assert made.of_jpeg == 59
    for one, other in zip(found, wanted(vectors), strict=True):
        assert one is not None
        assert one.valid == other.valid
        assert (one.values[:15] == other.values[:15]).all()  # gaze and hands do not come from pictures


def test_where_no_picture_is_features_are_as_recorded() -> None:
    rows, vectors = session()
    made = Made()
    found = anew([row for row in rows if not isinstance(row, SceneRow | ImageRow)], made)
    assert all(same(one, other) for one, other in zip(found, wanted(vectors), strict=True))
    assert made.as_recorded == 59


def test_where_features_are_lost_their_ticks_are_counted() -> None:
    rows, _ = session()
    made = Made()
    found = anew([row for row in rows if not (isinstance(row, FeaturesRow) and row.sequence == 3)], made)
    assert found.count(None) == made.lacking == 1


def test_a_detector_looks_at_the_pictures() -> None:
    rows, _ = session(10)
    found_by_it = [as_by_a_detector(row) for row in rows]

    class Sees:
        looked: list[int]

        def detect(self, frame: CameraFrame) -> HandTracks:
            self.looked = [*getattr(self, "looked", []), frame.captured_ns]
            return HandTracks(frame.captured_ns, ())

    detector = Sees()
    found = anew(found_by_it, Made(), Eyes(scene_frame, camera_frame, detector))
    assert detector.looked == [step * STEP for step in range(1, 10)]
    assert all(one is not None and not one.values[5:15].any() for one in found)
    # Hands without landmarks were no detector's (a skeleton's wrists): they stay as they were.
    detector.looked = []
    found = anew(rows, Made(), Eyes(scene_frame, camera_frame, detector))
    assert detector.looked == []
    assert any(one is not None and one.values[5:15].any() for one in found)
