"""How a hand moved, out of a recording of hilbridge, a CSV or an xsense.h5: the same tremor from each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.observe.recording import Recording
from hilbridge.rows import DeviceRow, InertialRow, MetaRow
from hilbridge.rows.fields import Witness
from hilbridge.tune.motion import Motion, motion_of, one_person

HERTZ, SIZE = 5.0, 2.0


def recording(path: Path, *rows: object, person: str | None = "P-07") -> Path:
    with Recording(path) as out:
        out.write(MetaRow(0, participant=person))
        for row in rows:
            out.write(row)  # type: ignore[arg-type]  # rows
    return path


def felt(sensor: str, count: int = 400, step_ms: int = 10, valid: bool = True) -> list[InertialRow]:
    made = []
    for number in range(count):
        at_ns = number * step_ms * MS
        shake = SIZE * np.sin(2 * np.pi * HERTZ * at_ns * 1e-9)
        made.append(InertialRow(at_ns + 5 * MS, at_ns, sensor, float(shake), 0.0, 9.81, valid))
    return made


def turned(witness: Witness, count: int = 200, size: float = SIZE) -> list[DeviceRow]:
    made = []
    for number in range(count):
        at_ns = number * 20 * MS
        speed = -np.degrees(size / 0.35) / (2 * np.pi * HERTZ) * np.cos(2 * np.pi * HERTZ * at_ns * 1e-9)
        made.append(DeviceRow(at_ns, witness, "Follow", "None", False, "None", True, velocity_deg_s=float(speed)))
    return made


def size_of(motion: Motion) -> float:
    return float(np.sqrt(2.0) * np.std(motion.acceleration[:, 0]))


def test_an_inertial_sensor_of_a_hand_is_taken_before_all_else(tmp_path: Path) -> None:
    rows = [*felt("STERNUM", 450), *felt("Hand_L", 300), *felt("HAND_R"), *felt("HAND_X", 900, valid=False)]
    rows = [*rows, *turned(Witness.BUS)]  # type: ignore[list-item]  # rows
    found = motion_of(recording(tmp_path / "a.mcap", *sorted(rows, key=lambda row: row.time_ns)))
    assert (found.name, found.person, found.said) == ("a.mcap", "P-07", "inertial sensor HAND_R")
    assert len(found.t_s) == 400
    assert size_of(found) == pytest.approx(SIZE, rel=0.02)
    assert list(found.hashes) == ["a.mcap"]


@pytest.mark.parametrize("witness", Witness)
def test_else_the_elbow_swings_the_hand(tmp_path: Path, witness: Witness) -> None:
    rows = turned(witness) if witness is Witness.BUS else [*turned(witness), *turned(Witness.BUS, size=9.0)]
    found = motion_of(recording(tmp_path / "a.mcap", *sorted(rows, key=lambda row: row.time_ns)))
    assert found.said == "the elbow as the device measured it"
    assert size_of(found) == pytest.approx(SIZE, rel=0.1)


def test_a_folder_is_a_recording_too(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    recording(folder / "recording.mcap", *felt("HAND_R"))
    found = motion_of(folder)
    assert (found.name, list(found.hashes)) == ("run", ["recording.mcap"])


def test_a_table(tmp_path: Path) -> None:
    path = tmp_path / "hand.csv"
    seconds = np.arange(0.0, 4.0, 0.01)
    shakes = SIZE * np.sin(2 * np.pi * HERTZ * seconds)
    table = np.column_stack([seconds, shakes, seconds * 0.0, seconds * 0.0])
    np.savetxt(path, table, delimiter=",", header="t_s,x,y,z", comments="")
    found = motion_of(path)
    assert (found.person, found.said) == (None, "hand acceleration")
    assert size_of(found) == pytest.approx(SIZE, rel=0.02)
    assert len(found.hashes["hand.csv"]) == 64


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ([], "has neither an inertial sensor of a hand nor the device's elbow; record with --inertial"),
        (felt("STERNUM"), "has neither"),
        (felt("HAND_R", 100), "needs rising stamps over 2 s or more"),
        (turned(Witness.BUS, 2), "needs rising stamps over 2 s or more"),
    ],
)
def test_what_says_nothing_of_a_hand_is_one_line(tmp_path: Path, rows: list[object], told: str) -> None:
    path = recording(tmp_path / "a.mcap", *rows)
    with pytest.raises(InputError) as caught:
        motion_of(path)
    assert str(caught.value).startswith(f"{path}: {told}")


def test_a_file_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="absent: no such file; name recordings"):
        motion_of(tmp_path / "absent")


def test_recordings_are_of_one_person() -> None:
    def of(person: str | None) -> Motion:
        return Motion("x", person, "", np.zeros(0), np.zeros((0, 3)), {})

    assert one_person([of(None), of("P-07"), of("P-07")]) == "P-07"
    assert one_person([of(None)]) is None
    with pytest.raises(InputError, match=r"recordings of 2 people \(P-07, P-08\); give those of one wearer"):
        one_person([of("P-08"), of("P-07")])
