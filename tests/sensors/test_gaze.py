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


def test_neon_gaze_is_played_by_the_scene_videos_clock(neon: Path) -> None:
    first = int(np.frombuffer((neon / "gaze ps1.time").read_bytes(), "<i8")[0])
    (neon / "Neon Scene Camera v1 ps1.time").write_bytes(np.array([first - 780_000_000], "<i8").tobytes())
    assert open_gaze(neon).time_ns[0] == 780_000_000
    (neon / "Neon Scene Camera v1 ps1.time").write_bytes(np.array([first + 20_000_000], "<i8").tobytes())
    recording = open_gaze(neon)
    assert recording.time_ns[0] == -20_000_000
    player = GazePlayer(recording)
    player._read_all()
    assert player.cell.counts().received == 6  # what was seen before the video began is not played
    (neon / "Neon Scene Camera v1 ps1.time").write_bytes(np.array([first + 10**12], "<i8").tobytes())
    with pytest.raises(InputError, match="before the scene video"):
        open_gaze(neon)


def test_neon_parts_are_in_the_order_of_their_numbers(neon: Path) -> None:
    first = np.frombuffer((neon / "gaze ps1.time").read_bytes(), "<i8")
    for number in (2, 10):
        (neon / f"gaze ps{number}.time").write_bytes((first + number * 10**9).tobytes())
        for kind in ("gaze", "worn"):
            shutil.copy(neon / f"{kind} ps1.raw", neon / f"{kind} ps{number}.raw")
    recording = open_gaze(neon)
    assert len(recording.time_ns) == 30
    assert recording.bad_rows == 0


def test_a_sample_without_a_worn_flag_is_invalid(neon: Path) -> None:
    (neon / "blinks ps1.raw").unlink()
    (neon / "worn ps1.raw").write_bytes(b"\xff" * 6)
    assert open_gaze(neon).valid.tolist() == [True] * 6 + [False] * 4
    for kind in ("raw", "time"):
        shutil.copy(neon / f"gaze ps1.{kind}", neon / f"gaze ps2.{kind}")
    stamps = np.frombuffer((neon / "gaze ps1.time").read_bytes(), "<i8")
    (neon / "gaze ps2.time").write_bytes((stamps + 10**9).tobytes())
    assert open_gaze(neon).valid.sum() == 6  # the second part has no flags at all


def test_the_200_hz_gaze_is_taken_where_it_has_more(neon: Path) -> None:
    stamps = np.frombuffer((neon / "gaze ps1.time").read_bytes(), "<i8")
    more = np.sort(np.concatenate([stamps, stamps + 2_500_000]))
    (neon / "gaze_200hz.time").write_bytes(more.tobytes())
    (neon / "gaze_200hz.raw").write_bytes(np.full((20, 2), 600, "<f4").tobytes())
    recording = open_gaze(neon)
    assert len(recording.time_ns) == 20
    assert recording.valid.tolist()[-2:] == [False, False]  # the flag of the sample before stands for what is between
    (neon / "worn_200hz.raw").write_bytes(b"\xff" * 20)
    assert open_gaze(neon).valid.tolist()[-2:] == [True, True]


def test_csv_of_the_neon_cloud(tmp_path: Path) -> None:
    lines = ["recording id,timestamp [ns],gaze x [px],gaze y [px],worn,blink id"]
    lines += [f"r,{10**18 + n * 5_000_000},800,{n * 300},{int(n != 1)},{'7' if n == 2 else ''}" for n in range(4)]
    (tmp_path / "gaze.csv").write_text("\ufeff" + "\n".join(lines) + "\n", encoding="utf-8")
    (tmp_path / "world_timestamps.csv").write_text(f"recording id,timestamp [ns]\nr,{10**18 - 40_000_000}\n")
    for place in (tmp_path, tmp_path / "gaze.csv"):
        recording = open_gaze(place)
        assert recording.time_ns.tolist() == [40_000_000, 45_000_000, 50_000_000, 55_000_000]
        assert recording.valid.tolist() == [True, False, False, True]
        assert (recording.x[0], recording.y[3]) == (0.5, 0.75)


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


OWN = [(0.04 * index, 0.25, 0.5) for index in range(20)]


def table(
    separator: str = ",", decimal: str = ".", header: str = "time_s,x,y", end: str = "\n", scale: float = 1
) -> str:
    rows = [[f"{time_s * scale:.3f}", f"{x:.3f}", f"{y:.3f}"] for time_s, x, y in OWN]
    lines = [header.replace(",", separator), *(separator.join(row).replace(".", decimal) for row in rows)]
    return end.join(lines) + end


@pytest.mark.parametrize(
    "text",
    [
        table(),
        "\ufeff" + table(),
        table(end="\r\n"),
        "\ufeff" + table(";", ",", end="\r\n"),
        table(";"),
        table("\t", ","),
    ],
)
def test_however_a_spreadsheet_writes_it_the_numbers_are_the_same(tmp_path: Path, text: str) -> None:
    path = tmp_path / "gaze.csv"
    path.write_bytes(text.encode())
    found = open_gaze(path)
    assert found.time_ns.tolist() == [index * 40_000_000 for index in range(20)]
    assert set(found.x) == {0.25}
    assert set(found.y) == {0.5}
    assert found.bad_rows == 0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (table(decimal=","), "are its decimals written with commas"),
        (table(scale=1000), "in another unit"),
        (table(scale=1e9), "in another unit"),
        ("time_s,x,y,comment\n" + "0,1,0,2\n" * 3 + "0,5,0,5,0\n", "more cells than the header"),
    ],
)
def test_what_would_be_a_wrong_time_or_place_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "gaze.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=said) as refused:
        open_gaze(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_pupil_core_export_counts_y_from_below_and_starts_with_its_video(tmp_path: Path) -> None:
    rows = [f"{100 + index * 0.01:.3f},0,{0.9 if index != 3 else 0.2},0.25,0.9" for index in range(50)]
    header = "gaze_timestamp,world_index,confidence,norm_pos_x,norm_pos_y"
    (tmp_path / "gaze_positions.csv").write_text("\n".join([header, *rows]) + "\n")
    (tmp_path / "world_timestamps.csv").write_text("# timestamps [seconds],pts\n99.9,0\n99.93,1\n")
    found = open_gaze(tmp_path)
    assert (found.format, int(found.time_ns[0])) == ("pupil core", 100_000_000)
    assert found.y[0] == pytest.approx(0.1)
    assert found.valid.tolist()[:5] == [True, True, True, False, True]
