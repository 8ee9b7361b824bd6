import cv2
import numpy as np
import pytest

from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import FRAME, GAZE, HANDS, HUE_BINS, PATCH, D
from hilbridge.features.scene import histogram, scene_features, shrink
from hilbridge.limits import MS
from hilbridge.records import CameraFrame, GazeSample, Hand, HandTracks
from hilbridge.wearer.person import Wearer


def picture(height: int, width: int) -> np.ndarray:
    rgb = np.full((height, width, 3), 90, dtype=np.uint8)
    cv2.circle(rgb, (width // 4, height // 2), height // 8, (20, 200, 40), -1)
    cv2.circle(rgb, (3 * width // 4, height // 2), height // 8, (30, 40, 210), -1)
    return rgb


def test_histogram_blocks_are_shares():
    squares = histogram(np.random.default_rng(0).integers(0, 180, (20, 30, 3), dtype=np.uint8)) ** 2
    assert squares[:HUE_BINS].sum() == pytest.approx(1.0, abs=1e-5)
    assert squares[HUE_BINS : HUE_BINS + 4].sum() == pytest.approx(1.0, abs=1e-5)
    assert squares[HUE_BINS + 4 :].sum() == pytest.approx(1.0, abs=1e-5)


def test_features_hardly_depend_on_the_cameras_resolution():
    small, _ = scene_features(picture(72, 128), None)
    large, _ = scene_features(picture(720, 1280), None)
    assert np.abs(small - large).max() < 0.05
    assert shrink(picture(720, 1280)).shape == (72, 128, 3)


def test_the_patch_sees_the_colour_under_the_gaze():
    rgb = picture(240, 320)
    _, green = scene_features(rgb, (0.25, 0.5))
    _, blue = scene_features(rgb, (0.75, 0.5))
    assert int(green[:HUE_BINS].argmax()) == (120 // 2) * HUE_BINS // 180 or green[:HUE_BINS].max() > 0.9
    assert int(green[:HUE_BINS].argmax()) != int(blue[:HUE_BINS].argmax())


def test_a_colourless_picture_has_no_hue():
    frame, _ = scene_features(np.full((50, 50, 3), 128, dtype=np.uint8), None)
    assert np.allclose(frame[:HUE_BINS] ** 2, 1.0 / HUE_BINS)


@pytest.mark.parametrize("shape", [(10, 10), (10, 10, 4), (1, 10, 3), (0, 0, 3)])
def test_what_is_not_a_picture_is_refused(shape: tuple[int, ...]):
    with pytest.raises(ValueError, match="expected"):
        scene_features(np.zeros(shape, dtype=np.uint8), None)


def test_each_modality_stands_alone():
    frame = CameraFrame(0, picture(72, 96), 0)
    gaze = GazeSample(0, 0.25, 0.5, True)
    hands = HandTracks(0, (Hand(0.3, 0.5, 0.9),))
    full = FeatureAssembler().update(frame, gaze, hands, 0)
    assert full.valid == (True, True, True)
    no_gaze = FeatureAssembler().update(frame, None, hands, 0)
    assert no_gaze.valid == (False, True, True)
    assert (no_gaze.values[GAZE] == 0.0).all()
    assert (no_gaze.values[PATCH] == no_gaze.values[FRAME]).all()
    no_hands = FeatureAssembler().update(frame, gaze, None, 0)
    assert no_hands.valid == (True, False, True)
    assert (no_hands.values[HANDS] == 0.0).all()
    no_frame = FeatureAssembler().update(None, gaze, hands, 0)
    assert no_frame.valid == (True, True, False)
    assert (no_frame.values[FRAME.start :] == 0.0).all()
    nothing = FeatureAssembler().update(None, None, None, 5)
    assert nothing.valid == (False, False, False)
    assert not nothing.values.any()


def test_oldest_stamp_is_the_oldest_input_used():
    assembler = FeatureAssembler()
    vector = assembler.update(
        CameraFrame(100 * MS, picture(72, 96), 0),
        GazeSample(130 * MS, 0.5, 0.5, True),
        HandTracks(60 * MS, ()),
        140 * MS,
    )
    assert vector.oldest_input_ns == 60 * MS
    assert vector.captured_ns == 140 * MS  # the moment of the step, whatever came in with it
    assert vector.values.shape == (D,)


def test_a_stale_frame_does_not_count():
    vector = FeatureAssembler().update(CameraFrame(0, picture(72, 96), 0), None, None, 151 * MS)
    assert vector.valid == (False, False, False)


def test_hostile_input_never_gets_out_as_nan():
    rng = np.random.default_rng(3)
    assembler = FeatureAssembler()
    odd = [float("nan"), float("inf"), -float("inf"), 1e300, 0.5, -0.3]
    for step in range(300):
        t_ns = step * 40 * MS
        gaze = GazeSample(t_ns, rng.choice(odd), rng.choice(odd), bool(rng.integers(2)))
        hands = HandTracks(t_ns, tuple(Hand(rng.choice(odd), rng.choice(odd), rng.choice(odd)) for _ in range(3)))
        frame = CameraFrame(t_ns, rng.integers(0, 256, (72, 96, 3), dtype=np.uint8), step)
        vector = assembler.update(frame, gaze, hands, t_ns)
        assert np.isfinite(vector.values).all()
        assert np.abs(vector.values).max() <= 20.0


def test_a_histogram_counts_every_pixel_as_opencv_and_numpy_do():
    rng = np.random.default_rng(4)
    for height, width in ((72, 96), (23, 31), (1, 1), (2, 5)):
        hsv = rng.integers(0, (180, 256, 256), (height, width, 3)).astype(np.uint8)
        weight = hsv[..., 1].astype(float) * hsv[..., 2]
        hues = np.bincount(hsv[..., 0].ravel().astype(int) * HUE_BINS // 180, weight.ravel(), HUE_BINS) / weight.sum()
        counts = [cv2.calcHist([hsv], [channel], None, [4], [0, 256]).ravel() / weight.size for channel in (1, 2)]
        assert histogram(hsv) == pytest.approx(np.sqrt(np.concatenate([hues, *counts])), abs=1e-7)


@pytest.mark.parametrize("size_px", [(96, 72), (640, 480)])
def test_a_palette_gives_the_features_of_the_picture_in_full_colour(size_px: tuple[int, int]):
    rng = np.random.default_rng(5)
    for seed in range(5):
        wearer = Wearer(seed, width_px=size_px[0], height_px=size_px[1])
        for t_ns in range(0, 20_000 * MS, 1_900 * MS):
            frame, gaze = wearer.frame(t_ns), (rng.uniform(-0.2, 1.2), rng.uniform(-0.2, 1.2))
            indexed = scene_features(frame.pixels, gaze, frame.palette)
            assert np.array_equal(indexed, scene_features(frame.rgb, gaze))


def test_indices_without_a_palette_and_beyond_it_are_refused():
    with pytest.raises(ValueError, match="expected"):
        scene_features(np.zeros((72, 96), dtype=np.uint8), None)
    with pytest.raises(ValueError, match="expected"):
        scene_features(np.zeros((72, 96, 3), dtype=np.uint8), None, np.zeros((4, 3), dtype=np.uint8))
    with pytest.raises(ValueError, match="size"):
        scene_features(np.full((72, 96), 4, dtype=np.uint8), None, np.zeros((4, 3), dtype=np.uint8))
