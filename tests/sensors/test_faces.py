import cv2
import numpy as np
import pytest

from hilbridge.sensors.faces import LOOK_EVERY, FaceBlur

skimage_data = pytest.importorskip("skimage.data")


@pytest.fixture(scope="module")
def astronaut():
    """A public-domain photograph that comes with scikit-image: a face at (180..270, 60..160)."""
    return np.ascontiguousarray(skimage_data.astronaut())


def detail(rgb):
    return float(cv2.Laplacian(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), cv2.CV_64F)[75:155, 185:265].var())


def test_a_face_is_found_and_nothing_is_left_of_it(astronaut):
    blur = FaceBlur()
    boxes = blur.faces(astronaut)
    assert any(x < 225 < x + w and y < 115 < y + h for x, y, w, h in boxes)
    assert detail(blur.apply(astronaut)) < 0.2 * detail(astronaut)
    assert blur.faces(blur.apply(astronaut)) == []


def test_a_face_stays_blurred_between_two_looks_and_for_one_look_more(astronaut):
    blur, empty = FaceBlur(), np.full_like(astronaut, 90)
    blur.apply(astronaut)
    for _ in range(LOOK_EVERY - 1):
        assert detail(blur.apply(astronaut)) < 0.2 * detail(astronaut)
    for _ in range(LOOK_EVERY):
        assert detail(blur.apply(astronaut)) < 0.2 * detail(astronaut)
    for _ in range(LOOK_EVERY):
        blur.apply(empty)
    assert blur.apply(empty) is empty


def test_pictures_without_a_face_and_of_any_size_are_left_alone():
    blur = FaceBlur()
    for height, width in ((1, 1), (3, 640), (480, 640)):
        rgb = np.full((height, width, 3), 90, np.uint8)
        assert blur.apply(rgb) is rgb


def test_the_original_is_not_touched(astronaut):
    before = astronaut.copy()
    FaceBlur().apply(astronaut)
    assert (astronaut == before).all()
