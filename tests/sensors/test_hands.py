from __future__ import annotations

import hashlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from hilbridge.errors import InputError
from hilbridge.records import CameraFrame
from hilbridge.sensors.hands import ALONE_PICTURES, LOOK_EVERY, HandCount, HandDetector


def test_absent_or_broken_model_names_file_and_cure(tmp_path: Path) -> None:
    absent = tmp_path / "none.task"
    with pytest.raises(InputError, match=r"none\.task: not there; .*fetch-models"):
        HandDetector(absent)
    broken = tmp_path / "broken.task"
    broken.write_bytes(b"garbage")
    with pytest.raises(InputError, match=r"broken\.task: neither the official file .*fetch-models --force"):
        HandDetector(broken)
    own = hashlib.sha256(b"garbage").hexdigest()
    with pytest.raises(InputError, match=r"broken\.task: mediapipe cannot load it .*fetch-models --force"):
        HandDetector(broken, sha256=own)


def _rgb(path: Path) -> np.ndarray:  # type: ignore[type-arg]
    return np.ascontiguousarray(cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB))


@pytest.mark.data
def test_real_photographs(hand_model: Path, data: Path) -> None:
    photographs = sorted((data / "hands").glob("*.jpg"))
    assert len(photographs) == 18
    found = {}
    for index, path in enumerate(photographs):
        with HandDetector(hand_model) as detector:  # photographs are not a sequence: each gets a fresh tracker
            tracks = detector.detect(CameraFrame(1_000_000_000, _rgb(path), index))
        found[path.name] = tracks.hands
        for hand in tracks.hands:
            assert -0.2 < hand.x < 1.2
            assert -0.2 < hand.y < 1.2
            assert 0.5 <= hand.score <= 1.0
    with_hand = [name for name in found if found[name]]
    assert len(with_hand) >= 15


@pytest.mark.data
def test_a_strided_picture_gives_the_same_hands(hand_model: Path, data: Path) -> None:
    picture = _rgb(sorted((data / "hands").glob("call-*.jpg"))[0])
    wide = np.zeros((picture.shape[0], picture.shape[1] + 7, 3), np.uint8)
    wide[:, : picture.shape[1]] = picture
    with HandDetector(hand_model) as detector:
        whole = detector.detect(CameraFrame(1_000_000, picture, 1))
    with HandDetector(hand_model) as detector:
        strided = detector.detect(CameraFrame(1_000_000, wide[:, : picture.shape[1]], 1))
    assert whole.hands == strided.hands
    assert whole.hands


@pytest.mark.data
def test_stamps_that_stand_still_do_not_stop_the_detector(hand_model: Path, data: Path) -> None:
    picture = _rgb(sorted((data / "hands").glob("call-*.jpg"))[0])
    with HandDetector(hand_model) as detector:
        for sequence in range(3):
            assert detector.detect(CameraFrame(5_000_000, picture, sequence)).hands


def test_two_hands_are_looked_for_until_there_has_been_one_for_a_while() -> None:
    count = HandCount()
    asked = []
    for _ in range(ALONE_PICTURES + 2 * LOOK_EVERY):
        asked.append(count.wanted)
        count.saw(1)
    assert asked == [2] * ALONE_PICTURES + ([2] + [1] * (LOOK_EVERY - 1)) * 2
    count.saw(2)
    assert count.wanted == 2
    assert not count.asks_again(1)
    assert count.asks_again(0)
    count.saw(0)
    assert not count.asks_again(0)  # what is gone is asked for once


@pytest.mark.data
def test_the_clip_has_as_many_hands_in_each_picture_as_with_two_always_looked_for(hand_model: Path, data: Path) -> None:
    capture, pictures = cv2.VideoCapture(str(data / "hands" / "clip_720p.mp4")), []
    while (read := capture.read())[0]:
        rgb = np.ascontiguousarray(cv2.cvtColor(read[1], cv2.COLOR_BGR2RGB))
        pictures.append(CameraFrame(len(pictures) * 40_000_000, rgb, len(pictures)))
    found, asked_for_one = [], 0
    for adaptive in (False, True):
        with HandDetector(hand_model, adaptive=adaptive) as detector:
            found.append([])
            for picture in pictures:
                asked_for_one += adaptive and detector.wanted == 1
                found[-1].append(len(detector.detect(picture).hands))
    assert found[0] == found[1]
    assert asked_for_one > len(pictures) / 2
