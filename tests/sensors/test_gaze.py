"""sensors.gaze and pupil_labs: three formats, what is wrong with a file in one line, real recordings."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from hilbridge.errors import InputError
from hilbridge.sensors.gaze import GazePlayer, open_gaze
from hilbridge.sensors.source import SourceState


@pytest.fixture
def neon(tmp_path: Path) -> Path:
    """A recording folder of ten samples, 5 ms apart, with one blink over samples 4 and 5, in the app's formats."""
    folder = tmp_path / "neon"
    folder.mkdir()
    start = 1_760_000_000_000_000_000
    stamps = start + np.arange(10, dtype="<i8") * 5_000_000
    points = np.column_stack([np.linspace(0, 1600, 10), np.linspace(0, 1200, 10)]).astype("<f4")
    (folder / "info.json").write_text(json.dumps({"gaze_frequency": 200}))
    (folder / "gaze ps1.time").write_bytes(stamps.tobytes())
    (folder / "gaze ps1.raw").write_bytes(points.tobytes())
    (folder / "worn ps1.raw").write_bytes(np.array([255] * 9 + [0], "u1").tobytes())
    blink = np.array([(4, stamps[4], stamps[5])], dtype=[("t", "<i4"), ("s", "<i8"), ("e", "<i8")])
    (folder / "blinks ps1.raw").write_bytes(blink.tobytes())
    return folder


def test_neon_folder(neon: Path) -> None:
    recording = open_gaze(neon)
    assert recording.format == "neon"
    assert recording.time_ns.tolist() == [index * 5_000_000 for index in range(10)]
    seen = recording.valid
    assert recording.x[seen] == pytest.approx(np.linspace(0, 1, 10)[seen])
    assert recording.y[seen] == pytest.approx(np.linspace(0, 1, 10)[seen])
    assert (recording.x[~seen] == 0.0).all()
    assert recording.valid.tolist() == [True] * 4 + [False] * 2 + [True] * 3 + [False]  # blink, and off the head


def test_csv_with_bad_rows_counted(tmp_path: Path) -> None:
    path = tmp_path / "gaze.csv"
    path.write_text(
        "time_s,x,y,valid\n0,0.1,0.2,1\n0.04,0.3,0.4,0\nbad,0,0,1\n0.02,0.5,0.5,1\n0.08,nan,0.5,1\n0.12,0.5,2.0,1\n"
    )
    recording = open_gaze(path)
    assert recording.bad_rows == 2  # one that is no number, one that goes back in time
    assert recording.valid.tolist() == [True, False, False, False]  # said so, NaN, outside the picture
    assert np.isfinite(recording.x).all()


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("none.csv", None, "no such file or folder"),
        ("empty.txt", "", "the file is empty"),
        ("empty.csv", "", "the file is empty"),
        ("columns.csv", "t,x\n1,2\n", "no column time_s, y"),
        ("rows.csv", "time_s,x,y\nfoo,1,2\n", "no row could be read (1 bad)"),
        ("one.csv", "time_s,x,y\n0,0.5,0.5\n", "needs at least two"),
        ("pixels.csv", "time_s,x,y\n0,640,480\n1,640,480\n", "must be 0..1"),
        ("huge.csv", "time_s,x,y\n1e400,0.5,0.5\n0,0.5,0.5\n", "needs at least two"),
        ("begaze.txt", "## [BeGaze]\nnothing\n", "begaze.txt"),
        ("cut.csv", "time_s,x,y\n0,0.5,0.5\n1,0.5,0.5\n2,0.5", "the last row lacks columns; it is truncated"),
        ("cut.txt", "## [BeGaze]\nTime\tType\tTri", "ends in the middle of a line; it is truncated"),
        ("binary.csv", b"time_s,x,y\n\xff\xfe\x00\n", "not a CSV text"),
        ("binary.txt", bytes(range(256)) * 20, "binary.txt"),
    ],
)
def test_what_cannot_be_read_is_one_line_with_file_and_cure(
    tmp_path: Path, name: str, content: str | bytes | None, said: str
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as refused:
        open_gaze(path)
    assert str(path) in str(refused.value)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda folder: (folder / "info.json").unlink(), "no info.json"),
        (lambda folder: (folder / "info.json").write_text("{"), "not readable as JSON"),
        (lambda folder: (folder / "info.json").write_text("[]"), "no Neon recording"),
        (lambda folder: (folder / "gaze ps1.raw").unlink(), "no `gaze ps1.raw`"),
        (lambda folder: (folder / "gaze ps1.time").unlink(), "No such file"),
        (lambda folder: (folder / "gaze ps1.raw").write_bytes(b"\0" * 79), "truncated"),
        (lambda folder: (folder / "gaze ps1.raw").write_bytes(b"\0" * 72), "truncated"),
        (lambda folder: (folder / "gaze ps1.time").write_bytes(b"\0" * 77), "no whole number of 8-byte records"),
        (lambda folder: (folder / "gaze ps1.raw").write_bytes(np.full(20, np.nan, "<f4").tobytes()), "no valid sample"),
    ],
)
def test_damaged_neon_folders(neon: Path, damage: object, said: str) -> None:
    damage(neon)  # type: ignore[operator]
    with pytest.raises(InputError) as refused:
        open_gaze(neon)
    assert str(neon) in str(refused.value)
    assert said in str(refused.value)


def test_playing_keeps_every_sample_and_ends(neon: Path) -> None:
    player = GazePlayer(open_gaze(neon))
    player.start()
    stamps = []
    while player.state is not SourceState.ENDED:
        sample = player.cell.wait(0.5)
        if sample is not None:
            stamps.append(sample.captured_ns)
    player.stop()
    counts = player.cell.counts()
    assert counts.received == 10 == counts.used + counts.overwritten
    assert stamps == sorted(set(stamps))


@pytest.mark.data
def test_real_neon_recording(data: Path) -> None:
    recording = open_gaze(data / "neon" / "demo_recording")
    assert len(recording.time_ns) == 1788
    assert recording.bad_rows == 0
    assert np.median(np.diff(recording.time_ns)) == pytest.approx(5_000_000, rel=0.02)
    assert 0.94 < recording.valid.mean() < 0.95  # two blinks of 235 and 255 ms in 8.96 s
    assert recording.x[recording.valid].min() > 0.3


@pytest.mark.data
@pytest.mark.parametrize("name", ["OP01-R02-TurkeySandwich", "P02-R06-GreekSalad"])
def test_real_begaze_exports(data: Path, name: str) -> None:
    recording = open_gaze(data / "egtea" / "gaze_data" / f"{name}.txt")
    assert recording.format == "begaze"
    assert len(recording.time_ns) > 10_000
    assert np.median(np.diff(recording.time_ns)) == pytest.approx(33_300_000, rel=0.02)
    assert recording.valid.mean() > 0.5


@pytest.mark.data
def test_a_truncated_real_recording_is_refused(data: Path, tmp_path: Path) -> None:
    copy = tmp_path / "cut"
    shutil.copytree(data / "neon" / "demo_recording", copy)
    raw = copy / "gaze ps1.raw"
    raw.chmod(0o644)
    raw.write_bytes(raw.read_bytes()[:-1000])
    with pytest.raises(InputError, match=r"gaze ps1\.raw: 13304 bytes for 1788 stamps"):
        open_gaze(copy)
