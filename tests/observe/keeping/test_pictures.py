"""observe.keeping.pictures: what is stored is the picture, smaller where asked; whoever offers one never waits."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from numpy.typing import NDArray

from hilbridge.features.scene import scene_features
from hilbridge.observe.keeping.pictures import PictureFormat, Pictures, camera_frame, image_row, scene_frame, scene_row
from hilbridge.records import CameraFrame
from hilbridge.rows import ImageRow, SceneRow


def gradient(height_px: int, width_px: int) -> NDArray[np.uint8]:
    across = np.linspace(0, 255, width_px).astype(np.uint8)
    return np.ascontiguousarray(np.broadcast_to(across[None, :, None], (height_px, width_px, 3)))


@pytest.mark.parametrize(("width_px", "stored"), [(1280, (360, 640)), (640, (360, 640)), (96, (72, 96))])
def test_a_picture_comes_back_smaller_where_asked_and_nearly_as_it_was(width_px: int, stored: tuple[int, int]) -> None:
    height_px = 72 if width_px == 96 else width_px * 9 // 16
    frame = CameraFrame(7, gradient(height_px, width_px), 3)
    row = image_row(frame, PictureFormat(quality=90, width_px=640), 9)
    assert (row.width_px, row.height_px, row.sequence, row.captured_ns, row.time_ns) == (width_px, height_px, 3, 7, 9)
    back = camera_frame(row)
    assert back.rgb.shape == (*stored, 3)
    error = np.abs(back.rgb.astype(int) - gradient(*stored).astype(int))
    assert error.mean() < 2


def test_colours_keep_their_places() -> None:
    red = np.zeros((32, 32, 3), np.uint8)
    red[..., 0] = 200
    back = camera_frame(image_row(CameraFrame(0, red, 0), PictureFormat(), 0)).rgb.reshape(-1, 3).mean(axis=0)
    assert back[0] > 190
    assert back[1:].max() < 10


def test_a_drawn_picture_is_stored_in_its_colours() -> None:
    palette = np.array([[0, 0, 0], [0, 0, 200]], np.uint8)
    frame = CameraFrame(0, np.ones((32, 32), np.uint8), 0, palette=palette)
    assert camera_frame(image_row(frame, PictureFormat(), 0)).rgb[..., 2].mean() > 190


def test_what_is_no_picture_is_refused() -> None:
    row = image_row(CameraFrame(0, gradient(16, 16), 5), PictureFormat(), 0)
    with pytest.raises(ValueError, match="picture 5 cannot be read"):
        camera_frame(ImageRow(**{name: getattr(row, name) for name in row.__slots__} | {"data": b"no JPEG"}))


def test_pictures_that_come_too_fast_are_dropped_and_counted() -> None:
    free, began = threading.Event(), threading.Event()
    kept: list[int] = []

    def record(row: ImageRow | SceneRow) -> None:
        began.set()
        free.wait(30)
        if isinstance(row, ImageRow):
            kept.append(row.sequence)

    pictures = Pictures(PictureFormat(), record)
    pictures.offer(CameraFrame(0, gradient(16, 16), 0), 1)
    assert began.wait(30)
    for number in range(1, 11):
        pictures.offer(CameraFrame(number, gradient(16, 16), number), 1)
    free.set()
    pictures.close()
    assert kept == [0, 1, 2, 3, 4]
    assert (pictures.stored, pictures.dropped, pictures.failed) == (5, 6, 0)


def test_one_that_cannot_be_stored_is_counted_and_the_next_is_stored() -> None:
    kept: list[ImageRow | SceneRow] = []
    pictures = Pictures(PictureFormat(), kept.append)
    pictures.offer(CameraFrame(0, np.zeros((0, 0, 3), np.uint8), 0), 1)
    pictures.offer(CameraFrame(1, gradient(16, 16), 1), 1)
    pictures.close()
    assert [(type(row), row.sequence) for row in kept] == [(SceneRow, 1), (ImageRow, 1)]
    assert pictures.failed == 1


def test_the_scene_of_a_picture_has_its_scene_features() -> None:
    frame = CameraFrame(7, np.random.default_rng(1).integers(0, 256, (480, 640, 3), np.uint8), 3)
    again = scene_frame(scene_row(frame, 9))
    assert again.captured_ns == 7
    for gaze in (None, (0.3, 0.7), (1.4, -0.2)):
        for one, other in zip(scene_features(frame.pixels, gaze), scene_features(again.pixels, gaze), strict=True):
            assert one.tobytes() == other.tobytes()


def test_a_scene_that_is_not_its_size_is_refused() -> None:
    with pytest.raises(ValueError, match="scene 3: 5 bytes for 2 x 1 pixels"):
        scene_frame(SceneRow(1, 1, 3, 2, 1, b"12345"))


def test_whatever_a_detector_raises_costs_its_picture_and_not_the_end_of_the_run() -> None:
    kept: list[ImageRow | SceneRow] = []
    pictures = Pictures(PictureFormat(), kept.append)
    for number in range(20):  # more than may wait
        pictures.offer(CameraFrame(number, None, number), 1)  # type: ignore[arg-type]
    pictures.close()
    assert kept == []
    assert pictures.failed + pictures.dropped == 20
