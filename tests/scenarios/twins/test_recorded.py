"""A recorded tremor as torque: its frequency and size come through, drift and gravity do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hilbridge.errors import InputError
from hilscenario.twins.recorded import torque_of

SECONDS = np.arange(0.0, 6.0, 0.012)
SHAKES = np.stack([2.0 * np.sin(2 * np.pi * 5.0 * SECONDS), 0.1 * SECONDS, np.full_like(SECONDS, 9.81)], axis=1)


def _checked(torque: tuple[float, ...]) -> None:
    power = np.abs(np.fft.rfft(torque))
    assert np.fft.rfftfreq(len(torque), 0.001)[power.argmax()] == pytest.approx(5.0, abs=0.2)
    assert np.max(torque) == pytest.approx(2.0 * 0.0698 / 0.35, rel=0.15)


def test_a_table(tmp_path: Path) -> None:
    path = tmp_path / "hand.csv"
    np.savetxt(path, np.column_stack([SECONDS, SHAKES]), delimiter=",", header="t_s,x,y,z", comments="")
    _checked(torque_of(path))


@pytest.mark.parametrize("older", [False, True])
def test_a_recording_of_inertial_sensors(tmp_path: Path, older: bool) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "xsense.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("Sensors/HAND_R")
        group["Accelerometer"] = SHAKES.T
        stamps = 1.7e9 + SECONDS[None, :]
        group["Timestamp" if older else "Timestamp_Sensor"] = stamps * 1e6 if older else stamps
    _checked(torque_of(path))


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "t_s,x,y,z\n0,0,0,0\n1,0,0,0\n", "t_s,x,y,z\n5,0,0,0\n1,0,0,0\n"])
def test_what_cannot_be_used_is_one_line_with_its_file(tmp_path: Path, text: str) -> None:
    path = tmp_path / "hand.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"hand\.csv: "):
        torque_of(path)
