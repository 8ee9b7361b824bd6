"""observe.keeping.sharing: one small picture in a folder that only its user reads, and nothing left when it is over."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.errors import InputError
from hilbridge.features.layout import D
from hilbridge.limits import MS
from hilbridge.observe.keeping.pictures import PictureFormat, image_row
from hilbridge.observe.keeping.sharing import (
    SHARED_GAP_NS,
    STALE_PICTURE_NS,
    SharedPicture,
    Sharing,
    newest_picture,
    packed,
    picture_of,
    picture_of_rows,
    shared_path,
    unpacked,
)
from hilbridge.records import CameraFrame, FeatureVector, GazeSample, Hand, HandTracks
from hilbridge.rows import ImageRow, Look, gaze_row, hands_row

LANDMARKS = (0.1, 0.2, -0.5, 0.3, 0.4, -0.5)
share = st.floats(-1, 2, allow_nan=False).map(lambda value: round(value, 4))
pictures = st.builds(
    SharedPicture,
    st.integers(0, 2**62),
    st.integers(1, 8192),
    st.integers(1, 8192),
    st.binary(min_size=1, max_size=200),
    st.none() | st.tuples(share, share),
    st.lists(st.lists(share, min_size=2, max_size=6).map(tuple), max_size=2).map(tuple),
)


def look_at(now_ns: int, *, gaze: bool = True) -> tuple[ImageRow, Look]:
    frame = CameraFrame(now_ns, np.zeros((36, 64, 3), np.uint8), 1)
    vector = FeatureVector(now_ns, now_ns, np.zeros(D, np.float32), (True, True, True))
    hands = HandTracks(now_ns, (Hand(0.25, 0.75, 0.9, LANDMARKS),))
    row = image_row(frame, PictureFormat(), now_ns)
    return row, Look(now_ns, vector, 1, GazeSample(now_ns, 0.5, 0.4, gaze), hands)


@given(pictures)
def test_it_comes_back_as_it_went(picture: SharedPicture) -> None:
    assert unpacked(packed(picture)) == picture


@given(st.binary(max_size=100), pictures, st.integers(0, 300))
def test_what_is_no_picture_is_none(noise: bytes, picture: SharedPicture, cut: int) -> None:
    content = packed(picture)
    assert unpacked(noise) is None
    whole = unpacked(content[:cut])
    assert whole is None or content.startswith(packed(whole)[:30])


def test_gaze_that_is_not_valid_is_not_shown_and_landmarks_have_no_depth() -> None:
    picture = picture_of(*look_at(7))
    assert (picture.gaze, picture.hands) == ((0.5, 0.4), ((0.25, 0.75, 0.1, 0.2, 0.3, 0.4),))
    assert picture_of(*look_at(7, gaze=False)).gaze is None
    row, look = look_at(7)
    assert picture_of(row, replace(look, gaze=None, hands=None)).overlay["hands"] == ()


def test_a_recording_gives_the_same_picture() -> None:
    row, look = look_at(7)
    assert look.gaze is not None
    assert look.hands is not None
    gaze, hands = gaze_row(look.gaze, 7), hands_row(look.hands, 7)
    assert picture_of_rows(row, gaze, hands) == picture_of(row, look)
    assert picture_of_rows(row, None, None).overlay == {"width": 64, "height": 36, "gaze": None, "hands": ()}


def test_ten_a_second_at_most_and_nothing_is_left(tmp_path: Path) -> None:
    path = tmp_path / "run" / "picture"
    with Sharing(path) as sharing:
        for step in range(25):
            sharing.offer(*look_at(step * 40 * MS))
        assert sharing.shared == 9  # every third of 40 ms
        assert (newest := newest_picture(path, 1000 * MS)) is not None
        assert newest.shared_ns == 24 * 40 * MS
    assert list(path.parent.iterdir()) == []
    sharing.offer(*look_at(10_000 * MS))  # a thread that has not heard yet
    assert list(path.parent.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="no modes there; the folder is in the user's profile")
def test_nobody_else_reads_it(tmp_path: Path) -> None:
    path = tmp_path / "run" / "picture"
    path.parent.mkdir(mode=0o755)
    with Sharing(path) as sharing:
        sharing.offer(*look_at(0))
        assert path.parent.stat().st_mode & 0o777 == 0o700


def test_what_a_killed_run_left_is_not_shown_and_goes_with_the_next(tmp_path: Path) -> None:
    path = tmp_path / "run" / "picture"
    path.parent.mkdir()
    path.write_bytes(packed(picture_of(*look_at(5))))
    assert newest_picture(path, 5 + STALE_PICTURE_NS) is not None
    assert newest_picture(path, 6 + STALE_PICTURE_NS) is None
    assert newest_picture(path, 4) is None  # of another boot
    with Sharing(path):
        assert not path.exists()


@pytest.mark.skipif(sys.platform == "win32", reason="links need a privilege there")
def test_a_folder_that_somebody_else_prepared_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "theirs").mkdir()
    (tmp_path / "run").symlink_to(tmp_path / "theirs")
    with pytest.raises(InputError, match="somebody else's"):
        Sharing(tmp_path / "run" / "picture")
    path = tmp_path / "theirs" / "picture"
    path.write_bytes(packed(picture_of(*look_at(5))))
    assert newest_picture(path, 5) is not None
    monkeypatch.setattr(os, "getuid", lambda: 4711)
    assert newest_picture(path, 5) is None
    with pytest.raises(InputError, match="somebody else's"):
        Sharing(path)


def test_a_disk_that_is_full_costs_the_picture_alone(tmp_path: Path) -> None:
    path = tmp_path / "run" / "picture"
    with Sharing(path) as sharing:
        path.mkdir()  # nothing can be put in its place
        (path / "in-the-way").touch()
        sharing.offer(*look_at(0))
        sharing.offer(*look_at(SHARED_GAP_NS))
        assert (sharing.shared, sharing.failed) == (0, 2)
        (path / "in-the-way").unlink()
        path.rmdir()


def test_each_bus_has_a_picture_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert shared_path("hilsim:a") != shared_path("hilsim:b")
    assert shared_path("hilsim:a").parent == shared_path("hilsim:b").parent
