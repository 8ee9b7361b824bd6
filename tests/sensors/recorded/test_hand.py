"""Acceleration of a hand from a file: stamps that cannot be seconds are one line, before memory is asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

from hilbridge.errors import InputError
from hilbridge.sensors.recorded.hand import MOST_S, hand_acceleration


def written(folder: Path, last_s: float) -> Path:
    path = folder / "hand.csv"
    path.write_text(f"t_s,x,y,z\n0,0,0,9.8\n1,0,1,9.8\n{last_s!r},1,0,9.8\n")
    return path


def test_a_day_is_read(tmp_path: Path) -> None:
    t_s, acceleration = hand_acceleration(written(tmp_path, MOST_S))
    assert t_s.tolist() == [0.0, 1.0, MOST_S]
    assert acceleration.shape == (3, 3)


@pytest.mark.parametrize("last_s", [MOST_S + 1.0, 1e18])
def test_more_than_a_day_is_one_line(last_s: float, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"longer than a day; give t_s in seconds") as refused:
        hand_acceleration(written(tmp_path, last_s))
    assert "\n" not in str(refused.value)
