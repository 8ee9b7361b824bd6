"""sensors.camera on made videos of every awkward kind: right pictures at the right times, or one line with the cure."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hilbridge.errors import InputError
from hilbridge.records import CameraFrame, StampSource
from hilbridge.sensors.camera import CameraSource
from hilbridge.sensors.pictures.capture import Reader
from hilbridge.sensors.pictures.stamps import taken_at

av = pytest.importorskip("av")
WIDTH, HEIGHT = 128, 96
READ_BY = [Reader.OPENCV]


@pytest.fixture(autouse=True, params=[Reader.OPENCV, Reader.PYAV])
def reader(request: pytest.FixtureRequest) -> Iterator[Reader]:
    """Every test is of either."""
    READ_BY[:] = [request.param]
    yield request.param
    READ_BY[:] = [Reader.OPENCV]


def source_of(path: Path, **more: Any) -> CameraSource:
    return CameraSource(str(path), reader=READ_BY[0], **more)


def make(
    path: Path,
    times_ms: list[int],
    *,
    codec: str = "mpeg4",
    form: str = "yuv420p",
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> Path:
    """A video whose pictures are red on the left, blue on the right, with a white corner at the top left."""
    width, height = size
    picture = np.zeros((height, width, 3), np.uint8)
    picture[:, : width // 2, 0], picture[:, width // 2 :, 2] = 255, 255
    picture[: height // 4, : width // 4] = 255
    rate = Fraction(1000, max(1, times_ms[1] - times_ms[0]))
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate)
        stream.width, stream.height, stream.pix_fmt = width, height, form
        stream.time_base = stream.codec_context.time_base = Fraction(1, 1000) if codec != "mjpeg" else 1 / rate
        for index, time_ms in enumerate(times_ms):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts = time_ms if codec != "mjpeg" else index
            frame.time_base = stream.codec_context.time_base
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode(None):
            container.mux(packet)
    return path


class Clock:
    """A clock that stands still until the source waits for a moment; then it is that moment."""

    def __init__(self) -> None:
        self.now_ns = 10**12

    def __call__(self) -> int:
        return self.now_ns


def played(path: Path, fps: float | None = None) -> list[CameraFrame]:
    clock = Clock()
    source = source_of(path, fps=fps, clock_ns=clock)
    frames: list[CameraFrame] = []
    source.on_value = frames.append

    def at_once(due_ns: int) -> bool:
        clock.now_ns = max(clock.now_ns, due_ns)
        return True

    source._sleep_until = at_once  # type: ignore[method-assign]
    source._run()
    source.stop()
    return frames


def times_ms(frames: list[CameraFrame]) -> list[float]:
    return [(frame.captured_ns - frames[0].captured_ns) / 1e6 for frame in frames]


VARIABLE = [0, 33, 67, 150, 160, 300, 333, 1000, 1040]


@pytest.mark.parametrize(
    "times",
    [[0, 1000, 2000, 3000], [round(i * 1000 / 120) for i in range(60)], VARIABLE, [i * 40 for i in range(20)]],
    ids=["1 fps", "120 fps", "variable", "25 fps"],
)
@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_pictures_come_at_their_own_times(tmp_path: Path, times: list[int], suffix: str) -> None:
    frames = played(make(tmp_path / f"one.{suffix}", times))
    assert len(frames) == len(times)
    assert times_ms(frames) == pytest.approx(times, abs=2)


def corner(frame: CameraFrame) -> tuple[str, ...]:
    """Which corners are white, and the picture's shape."""
    rgb = frame.rgb
    height, width = rgb.shape[:2]
    places = {
        "top left": (4, 4),
        "top right": (4, width - 5),
        "bottom left": (height - 5, 4),
        "bottom right": (height - 5, width - 5),
    }
    return tuple(name for name, place in places.items() if rgb[place].min() > 200)


ROTATIONS = {
    90: ((0, 0x10000, -0x10000, 0), "top right"),
    180: ((-0x10000, 0, 0, -0x10000), "bottom right"),
    270: ((0, -0x10000, 0x10000, 0), "bottom left"),
}


@pytest.mark.parametrize("degrees", ROTATIONS)
def test_a_video_of_a_phone_held_upright_is_upright(tmp_path: Path, degrees: int) -> None:
    path = make(tmp_path / "one.mp4", [0, 40, 80])
    (a, b, c, d), where = ROTATIONS[degrees]
    data = bytearray(path.read_bytes())
    matrix = struct.pack(">9i", 0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000)
    at = data.index(matrix, data.index(b"tkhd"))
    data[at : at + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 0x40000000)
    path.write_bytes(bytes(data))
    frames = played(path)
    assert corner(frames[0]) == (where,)
    assert frames[0].pixels.shape[:2] == ((HEIGHT, WIDTH) if degrees == 180 else (WIDTH, HEIGHT))
    source = source_of(path)
    assert (source.height, source.width) == frames[0].pixels.shape[:2]
    source._capture.release()


def test_grey_pictures_are_pictures(tmp_path: Path) -> None:
    frames = played(make(tmp_path / "one.mkv", [0, 40, 80], codec="ffv1", form="gray"))
    assert len(frames) == 3
    assert frames[0].pixels.shape == (HEIGHT, WIDTH, 3)
    assert corner(frames[0]) == ("top left",)


def test_a_picture_of_4k_is_whole(tmp_path: Path) -> None:
    frames = played(make(tmp_path / "one.mp4", [0, 40], size=(3840, 2160)))
    assert frames[0].pixels.shape == (2160, 3840, 3)
    assert corner(frames[1]) == ("top left",)


def test_an_mjpeg_avi_without_its_index_is_played(tmp_path: Path) -> None:
    path = make(tmp_path / "one.avi", [i * 40 for i in range(12)], codec="mjpeg", form="yuvj420p")
    data = path.read_bytes()
    path.write_bytes(data[: data.rindex(b"idx1")])
    frames = played(path)
    assert len(frames) == 12
    assert times_ms(frames) == pytest.approx([i * 40 for i in range(12)], abs=2)


def test_a_video_that_was_cut_is_played_to_the_cut(tmp_path: Path) -> None:
    path = make(tmp_path / "one.mkv", [i * 40 for i in range(40)], codec="mjpeg", form="yuvj420p")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    frames = played(path)
    assert 10 < len(frames) < 25
    assert times_ms(frames) == pytest.approx([i * 40 for i in range(len(frames))], abs=2)


def test_an_mp4_that_was_cut_is_one_line(tmp_path: Path) -> None:
    path = make(tmp_path / "one.mp4", [i * 40 for i in range(40)])
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    refused(path, "is no video that can be decoded")


def test_sound_alone_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "one.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=48_000)
        frame: Any = av.AudioFrame.from_ndarray(np.zeros((1, 48_000), np.float32), format="fltp", layout="mono")
        frame.rate = 48_000
        for packet in [*stream.encode(frame), *stream.encode(None)]:
            container.mux(packet)
    refused(path, "video")


def refused(path: Path, said: str) -> None:
    with pytest.raises(InputError, match=said) as refusal:
        source_of(path)
    assert str(path) in str(refusal.value)
    assert "; " in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("said", [0.0, 1000.0, 90_000.0, float("nan"), -1.0])
def test_a_rate_that_none_has_is_told_from_the_stamps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reader: Reader, said: float
) -> None:
    """OpenCV hands on what a container or driver says: 0, 1000 and 90000 are time bases, not rates."""
    path = make(tmp_path / "one.mp4", [i * 40 for i in range(30)])
    import cv2

    if reader is Reader.PYAV:
        monkeypatch.setattr("hilbridge.sensors.pictures.pyav.PyAvCapture.fps", said)
    real = cv2.VideoCapture

    class Said:
        def __init__(self, *given: Any) -> None:
            self._capture = real(*given)

        def get(self, what: int) -> float:
            return said if what == cv2.CAP_PROP_FPS else float(self._capture.get(what))

        def __getattr__(self, name: str) -> Any:
            return getattr(self._capture, name)

    monkeypatch.setattr(cv2, "VideoCapture", Said)
    source = source_of(path)
    assert source.fps == pytest.approx(25, rel=0.02)
    source._capture.release()


S = 1_000_000_000
NOW = 100 * S


@pytest.mark.parametrize(
    ("said_ms", "last_ns", "taken_ns", "stamp"),
    [
        (99_980.0, 0, 99_980_000_000, StampSource.HARDWARE),
        (100_000.0, 0, NOW, StampSource.HARDWARE),
        (100_001.0, 0, NOW - 7, StampSource.ARRIVAL),  # ahead
        (98_999.0, 0, NOW - 7, StampSource.ARRIVAL),  # more than a second back: another clock
        (0.0, 0, NOW - 7, StampSource.ARRIVAL),
        (float("nan"), 0, NOW - 7, StampSource.ARRIVAL),
        (1.79e12, 0, NOW - 7, StampSource.ARRIVAL),  # wall clock
        (99_980.0, 99_990_000_000, NOW - 7, StampSource.ARRIVAL),  # goes back
        (0.0, NOW - 3, NOW - 2, StampSource.ARRIVAL),
        (0.0, NOW, NOW, StampSource.ARRIVAL),
    ],
)
def test_a_drivers_stamp_counts_only_where_it_is_of_this_clock(
    said_ms: float, last_ns: int, taken_ns: int, stamp: StampSource
) -> None:
    assert taken_at(said_ms, NOW, 7, last_ns) == (taken_ns, stamp)
