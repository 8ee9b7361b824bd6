"""sensors.recorded.iassistadl: made recordings of the layout, new and old, lossy, with clocks apart, cut and renamed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hilbridge.doctor_sensors import Verdict, check_gaze
from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.sensors.gaze import open_gaze
from hilbridge.sensors.recorded.iassistadl import is_iassistadl, read_iassistadl

h5py = pytest.importorskip("h5py")
START_S = 1_760_000_000.0


def make(
    folder: Path,
    *,
    old: bool = False,
    gaze_off_s: float = 0.0,
    inertial_off_s: float = 0.0,
    lose: int = 0,
    tremor_hz: float | None = None,
) -> Path:
    """Ten seconds: gaze at 200 Hz, two inertial sensors at 100 Hz, a skeleton at 30 Hz; delays of 1 to 20 ms.

    tremor_hz: the hands shake with 2 m/s^2 from 5 s on; else they are noise of 1 m/s^2.
    """
    folder.mkdir()
    random = np.random.default_rng(3)

    def delays(count: int) -> np.ndarray:
        return 0.001 + np.minimum(random.exponential(0.004, count), 0.019)

    seen = START_S + np.arange(2000) / 200
    x, y = 544 + 100 * np.sin(seen - START_S), 540 + 0 * seen
    lines = ["gaze_x,gaze_y,gaze_sensor_timestamps,gaze_processing_timestamps"]
    for row in zip(x, y, seen + gaze_off_s, seen + delays(2000), strict=True):
        lines.append(",".join(f"{number:.6f}" for number in row))
    (folder / "gaze.csv").write_text("\n".join(lines) + "\n")
    kept = np.delete(np.arange(1000), np.arange(100, 100 + lose)) if lose else np.arange(1000)
    stamps = START_S + kept / 100
    with h5py.File(folder / "xsense.h5", "w") as file:
        for name in ("HAND_R", "FOREARM_R"):
            group = file.create_group(f"Sensors/{name}")
            felt = random.normal(size=(3, len(kept)))
            if tremor_hz is not None:
                felt = 0.05 * felt
                felt[0] += np.where(kept >= 500, 2.8 * np.sin(2 * np.pi * tremor_hz * kept / 100), 0.0)
            group["Accelerometer"] = felt
            group["SeqID"] = kept[None, :]
            if old:
                group["Timestamp"] = (stamps * 1e6)[None, :]
            else:
                group["Timestamp_Sensor"] = (stamps + inertial_off_s)[None, :]
                group["Timestamp_Processing"] = (stamps + delays(len(kept)))[None, :]
    frames = START_S + np.arange(300) / 30
    with h5py.File(folder / "zed2i_skeleton3d.h5", "w") as file:
        file["Skeletons/Body_21/RIGHT_WRIST/SkeletonJoint3d"] = np.tile((0.1, 0.2, 1.0), (300, 1))
        place = "" if old else "Skeletons/Body_21/"
        file[f"{place}Timestamps/Timestamp_Sensor"] = frames[None, :]
        file[f"{place}Timestamps/Timestamp_Processing"] = (frames + delays(300))[None, :]
    (folder / "events.csv").write_text(f"timestamp\n{START_S + 5}\n")
    return folder


@pytest.mark.parametrize("old", [False, True])
def test_both_versions_are_read(tmp_path: Path, old: bool) -> None:
    folder = make(tmp_path / "one", old=old, lose=7)
    assert is_iassistadl(folder)
    found = read_iassistadl(folder)
    assert found.gaze.rate_hz == pytest.approx(200, rel=0.01)
    assert {stream.name: stream.lost for stream in found.inertial} == {"HAND_R": 7, "FOREARM_R": 7}
    assert [stream.name for stream in found.wrists] == ["RIGHT_WRIST"]
    assert found.events_ns == (round(START_S + 5) * 10**9,)
    starts = {int(stream.time_ns[0]) for stream in (found.gaze, *found.inertial, *found.wrists)}
    assert max(starts) - min(starts) < MS
    played = open_gaze(folder)
    assert (played.format, len(played.time_ns)) == ("iassistadl", 2000)
    assert played.x[0] == pytest.approx(0.5)


@pytest.mark.parametrize(("gaze_off_s", "inertial_off_s"), [(0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.15, -0.15)])
def test_clocks_300_ms_apart_are_aligned_within_5(tmp_path: Path, gaze_off_s: float, inertial_off_s: float) -> None:
    found = read_iassistadl(make(tmp_path / "one", gaze_off_s=gaze_off_s, inertial_off_s=inertial_off_s))
    for stream in (found.gaze, *found.inertial, *found.wrists):
        assert abs(int(stream.time_ns[0]) - START_S * 1e9) < 5 * MS, stream.name


def test_an_ordinary_delay_is_a_delay_and_is_told(tmp_path: Path) -> None:
    found = read_iassistadl(make(tmp_path / "one"))
    assert found.gaze.shift_ns == 0
    assert found.gaze.delay_ms is not None
    assert 1 < found.gaze.delay_ms[0] < found.gaze.delay_ms[1] <= 20.1


def test_doctor_says_what_is_there(tmp_path: Path) -> None:
    finding = check_gaze(str(make(tmp_path / "one", lose=7, gaze_off_s=0.3)))
    assert finding.verdict is Verdict.WELL
    for said in ("iassistadl", "clock shifted by -29", "HAND_R 99.3 Hz, 7 lost", "RIGHT_WRIST", "delay"):
        assert said in finding.text


@pytest.mark.parametrize("name", ["xsense.h5", "zed2i_skeleton3d.h5", "events.csv"])
def test_a_stream_may_be_absent(tmp_path: Path, name: str) -> None:
    folder = make(tmp_path / "one")
    (folder / name).unlink()
    assert len(read_iassistadl(folder).gaze.time_ns) == 2000


@pytest.mark.parametrize("name", ["gaze.csv", "xsense.h5", "zed2i_skeleton3d.h5", "events.csv"])
@pytest.mark.parametrize("share", [0.0, 0.03, 0.5, 0.97])
def test_a_file_that_was_cut_is_one_line(tmp_path: Path, name: str, share: float) -> None:
    path = make(tmp_path / "one") / name
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(InputError) as refused:
        read_iassistadl(path.parent)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_no_gaze_and_a_group_of_another_name_are_one_line(tmp_path: Path) -> None:
    folder = make(tmp_path / "one")
    with h5py.File(folder / "xsense.h5", "a") as file:
        file.move("Sensors", "Things")
    with pytest.raises(InputError, match="another layout"):
        read_iassistadl(folder)
    (folder / "gaze.csv").rename(folder / "look.csv")
    with pytest.raises(InputError, match="no such file"):
        open_gaze(folder)
