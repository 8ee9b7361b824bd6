"""sensors.camera: real decoding, every frame accounted for, errors in one line."""

from __future__ import annotations

import functools
import http.server
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from hilbridge.errors import InputError
from hilbridge.records import CameraFrame
from hilbridge.sensors.camera import CameraSource
from hilbridge.sensors.source import SourceState

FRAMES = 12


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """A short clip whose n-th picture is n * 20 grey with a red bar, so that order and colours can be checked."""
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 200.0, (64, 48))
    for index in range(FRAMES):
        picture = np.full((48, 64, 3), index * 20, np.uint8)
        picture[:, :32] = (0, 0, 255)
        writer.write(picture)
    writer.release()
    return path


def play(source: CameraSource) -> list[CameraFrame]:
    seen = []
    source.start()
    while (frame := source.cell.wait(5.0)) is not None:
        seen.append(frame)
        if source.state is SourceState.ENDED and not source.cell.counts().pending:
            break
        if len(seen) + source.cell.counts().overwritten >= FRAMES:
            break
    source.stop()
    return seen


def test_a_file_can_be_played_at_another_rate_and_a_stream_cannot(video: Path) -> None:
    source = CameraSource(str(video), fps=125.0)
    stamps = {frame.sequence: frame.captured_ns for frame in play(source)}
    first = min(stamps)
    assert source.fps == 125.0
    assert all(stamp - stamps[first] == (number - first) * 8_000_000 for number, stamp in stamps.items())
    with pytest.raises(InputError, match="leave --camera-fps out"):
        CameraSource("rtsp://127.0.0.1:9/none", fps=25.0)


def test_plays_a_file_in_order_as_contiguous_rgb(video: Path) -> None:
    source = CameraSource(str(video))
    frames = play(source)
    counts = source.cell.counts()
    assert (source.width, source.height, round(source.fps)) == (64, 48, 200)
    assert counts.received == FRAMES == counts.used + counts.overwritten + counts.failed
    assert [frame.sequence for frame in frames] == sorted({frame.sequence for frame in frames})
    stamps = [frame.captured_ns for frame in frames]
    assert stamps == sorted(set(stamps))
    for frame in frames:
        assert frame.rgb.dtype == np.uint8
        assert frame.rgb.shape == (48, 64, 3)
        assert frame.rgb.flags["C_CONTIGUOUS"]
        red, green, blue = frame.rgb[24, 8]
        assert red > 200
        assert max(green, blue) < 60
        assert abs(int(frame.rgb[24, 56, 0]) - (frame.sequence - 1) * 20) < 12


def test_a_neon_scene_video_is_played_by_the_stamps_beside_it(video: Path) -> None:
    stamps = 10**18 + np.cumsum([0, 5, 5, 40, 5, 5, 5, 5, 5, 5, 5, 5]) * 1_000_000
    video.with_suffix(".time").write_bytes(stamps.astype("<i8").tobytes())
    seen = {frame.sequence: frame.captured_ns for frame in play(CameraSource(str(video)))}
    first = min(seen)
    assert len(seen) > 2
    for number, stamp in seen.items():
        assert stamp - seen[first] == stamps[number - 1] - stamps[first - 1]


def test_a_file_without_usable_stamps_goes_by_its_rate(video: Path) -> None:
    source = CameraSource(str(video))
    assert [source._offset_ns(n, 0.0, None, n * 5_000_000 - 5_000_000) for n in range(1, 4)] == [5e6, 10e6, 15e6]
    assert source._offset_ns(3, 70.0, None, 10) == 70_000_000
    source.stop()


def test_a_character_device_is_a_device_not_a_missing_file() -> None:
    with pytest.raises(InputError, match="no /dev/videoN"):
        CameraSource("/dev/null")


def test_a_looped_file_goes_on(video: Path) -> None:
    source = CameraSource(str(video), loop=True)
    source.start()
    last = 0
    while last <= FRAMES:
        frame = source.cell.wait(5.0)
        assert frame is not None
        last = frame.sequence
    source.stop()
    assert source.cell.counts().balanced


@pytest.mark.parametrize(
    ("name", "content", "cure"),
    [
        ("absent.mp4", None, "no such file"),
        ("empty.mp4", b"", "no video"),
        ("text.mp4", b"this is not a video\n" * 50, "no video"),
    ],
)
def test_what_cannot_be_played_is_one_line_with_file_and_cure(
    tmp_path: Path, name: str, content: bytes | None, cure: str
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError) as refused:
        CameraSource(str(path))
    assert str(path) in str(refused.value)
    assert cure in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_truncated_video_plays_what_it_holds_and_ends(tmp_path: Path, video: Path) -> None:
    cut = tmp_path / "cut.avi"
    cut.write_bytes(video.read_bytes()[: video.stat().st_size * 2 // 3])
    source = CameraSource(str(cut))
    source.start()
    while source.state is not SourceState.ENDED:
        source.cell.wait(0.5)
    source.stop()
    counts = source.cell.counts()
    assert 0 < counts.received < FRAMES
    assert counts.balanced


def test_a_device_that_is_not_there_says_how_to_find_one() -> None:
    with pytest.raises(InputError, match=r"camera 63: cannot be opened; .*v4l2-ctl"):
        CameraSource("63")


@pytest.mark.data
def test_the_real_clip_decodes_at_720p(data: Path) -> None:
    source = CameraSource(str(data / "hands" / "clip_720p.mp4"))
    assert (source.width, source.height, source.fps) == (1280, 720, 30.0)
    source.start()
    frame = source.cell.wait(5.0)
    source.stop()
    assert frame is not None
    assert frame.rgb.shape == (720, 1280, 3)
    assert frame.rgb.std() > 10


class _Clips(http.server.SimpleHTTPRequestHandler):
    """Serves the folder's clip, saying nothing."""

    def log_message(self, format: str, *args: object) -> None: ...


def test_a_url_that_ends_is_gone_and_comes_back(video: Path) -> None:
    """A stream that breaks off is no end of the run: the bridge holds, and goes on when it is there again."""
    handler = functools.partial(_Clips, directory=str(video.parent))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        source = CameraSource(f"http://127.0.0.1:{server.server_address[1]}/{video.name}")
        source.start()
        last, was_gone = 0, False
        while last <= FRAMES:
            frame = source.cell.wait(0.05)
            was_gone = was_gone or source.state is SourceState.GONE
            last = last if frame is None else frame.sequence
        source.stop()
        server.shutdown()
    counts = source.cell.counts()
    assert was_gone
    assert counts.failed >= 1
    assert counts.balanced


def test_a_url_with_nobody_behind_it_is_refused() -> None:
    with pytest.raises(InputError, match=r"camera http://127\.0\.0\.1:9/x\.mp4: cannot be opened"):
        CameraSource("http://127.0.0.1:9/x.mp4")


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ("/dev/null", "is a device but no /dev/videoN"),
        ("/dev/video77", "camera 77: cannot be opened"),
        ("99999999999999999999", "no such number"),
    ],
)
def test_a_camera_may_be_named_by_its_path(spec: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        CameraSource(spec)
