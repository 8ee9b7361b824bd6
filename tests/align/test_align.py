"""align: offsets put into made signals come back, what cannot be told is refused in a line, and the configuration takes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbridge.align.events import claps, flashes, impacts, saccades
from hilbridge.align.measure import By, measure
from hilbridge.align.pairing import constant_offset
from hilbridge.align.written import put_line, write_line
from hilbridge.cli import main
from hilbridge.config import load_config
from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.observe.recording import Recording
from hilbridge.rows import GazeRow, HandFound, HandsRow, InertialRow, MetaRow, Row, SceneRow

SECONDS = 30
START_NS = 10**12
random = np.random.default_rng(5)
MOMENTS = START_NS + np.cumsum(random.uniform(1.5, 4.0, 8) * 1e9).astype(np.int64)
PICTURES = START_NS + np.arange(25 * SECONDS, dtype=np.int64) * 40 * MS


def gaze(late_ms: float, latency_ms: float = 200.0, rate_hz: int = 200) -> list[Row]:
    """Eyes that rest, jump to each flash and back in between, one blink a while; stamped too late by so much."""
    noise = np.random.default_rng(1)
    stays_ms = noise.uniform(300, 1300, len(MOMENTS)).tolist()
    rows: list[Row] = []
    for number in range(rate_hz * SECONDS):
        when_ns = START_NS + number * 10**9 // rate_hz
        passed = [(when_ns - moment) / MS - latency_ms for moment in MOMENTS.tolist()]
        away = any(0 <= one < stays for one, stays in zip(passed, stays_ms, strict=True))
        edge = [min(1.0, one / 40) for one in passed if 0 <= one < 40]
        x = 0.3 + 0.3 * (edge[0] if edge else float(away)) + noise.normal(0, 0.001)
        stamped_ns = when_ns + round(late_ms * MS)
        rows.append(GazeRow(stamped_ns, stamped_ns, number % 900 > 12, float(x), float(0.5 + noise.normal(0, 0.001))))
    return rows


def pictures() -> list[Row]:
    rows: list[Row] = []
    for number, when_ns in enumerate(PICTURES.tolist()):
        lit = any(0 <= when_ns - moment < 300 * MS for moment in MOMENTS.tolist())
        rgb = np.full((4, 8, 3), 160 if lit else 90 + number % 3, np.uint8)
        rows.append(SceneRow(when_ns, when_ns, number, 8, 4, rgb.tobytes()))
    return rows


def clapping(late_ms: float) -> list[Row]:
    """Palms that meet at each moment, seen 25 times a second, felt 100 times."""
    noise = np.random.default_rng(2)
    rows: list[Row] = []
    for when_ns in PICTURES.tolist():
        away = min(abs(when_ns - moment) for moment in MOMENTS.tolist()) * 1e-9
        apart = min(0.5, 0.06 + 2.0 * away) + noise.normal(0, 0.002)
        rows.append(HandsRow(when_ns, when_ns, 2, (HandFound(0.5 - apart / 2, 0.5), HandFound(0.5 + apart / 2, 0.5))))
    for number in range(100 * SECONDS):
        when_ns = START_NS + number * 10 * MS
        struck = any(0 <= when_ns - moment < 20 * MS for moment in MOMENTS.tolist())
        stamped_ns = when_ns + round(late_ms * MS)
        x, y, z = noise.normal((40.0 * struck, 0.0, 9.81), 0.3)
        rows.append(InertialRow(stamped_ns, stamped_ns, "HAND_R", float(x), float(y), float(z)))
    return rows


def recorded(folder: Path, rows: list[Row]) -> Path:
    path = folder / "run.mcap"
    with Recording(path) as recording:
        recording.write(MetaRow(START_NS))
        for row in sorted(rows, key=lambda row: row.time_ns):
            recording.write(row)
    return path


@pytest.mark.parametrize("late_ms", [-300.0, -20.0, 0.0, 35.0, 250.0])
def test_gaze_that_is_stamped_late_is_found_by_flashes(tmp_path: Path, late_ms: float) -> None:
    found = measure(recorded(tmp_path, [*pictures(), *gaze(late_ms)]), By.FLASH)
    assert found.value_ms == pytest.approx(-late_ms, abs=15)
    assert found.offset.pairs >= 6
    assert found.key == "gaze_offset_ms"


@pytest.mark.parametrize("late_ms", [-400.0, 0.0, 60.0, 300.0])
def test_inertial_sensors_that_are_stamped_late_are_found_by_claps(tmp_path: Path, late_ms: float) -> None:
    found = measure(recorded(tmp_path, clapping(late_ms)), By.CLAP)
    assert found.value_ms == pytest.approx(-late_ms, abs=15)
    assert found.offset.pairs >= 6


def test_what_was_not_recorded_is_one_line(tmp_path: Path) -> None:
    path = recorded(tmp_path, gaze(0.0)[:10])
    with pytest.raises(InputError, match="record it with video and gaze"):
        measure(path, By.FLASH)
    with pytest.raises(InputError, match="record it with --inertial and hands"):
        measure(path, By.CLAP)


def test_too_few_an_even_rhythm_and_chance_are_refused() -> None:
    beats = np.arange(10, dtype=np.int64) * 400 * MS
    with pytest.raises(InputError, match="equally likely"):
        constant_offset(beats, beats + 30 * MS)
    with pytest.raises(InputError, match="pairs are due"):
        constant_offset(beats[:1], beats[:2])
    far = np.random.default_rng(3).integers(0, 10**11, 40)
    with pytest.raises(InputError, match="align: "):
        constant_offset(np.sort(far[:20]), np.sort(far[20:]))


@settings(max_examples=50)
@given(st.integers(-800, 800), st.integers(0, 2**32 - 1))
def test_an_offset_comes_back_though_some_are_missed_and_some_are_false(offset_ms: int, seed: int) -> None:
    chance = np.random.default_rng(seed)
    first = np.cumsum(chance.uniform(2.0, 5.0, 20) * 1e9).astype(np.int64)
    second = first + offset_ms * MS + chance.normal(0, 5 * MS, 20).astype(np.int64)
    false = chance.integers(0, int(first[-1]), 3)
    found = constant_offset(first[chance.random(20) > 0.1], np.sort(np.concatenate([second[2:], false])))
    assert abs(found.offset_ns - offset_ms * MS) < 10 * MS


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_a_few_samples_hold_nothing(count: int) -> None:
    times, ones = np.arange(count, dtype=np.int64), np.ones(count)
    for found in (
        flashes(times, ones),
        saccades(times, ones, ones),
        impacts(times, np.ones((count, 3))),
        claps(times, ones),
    ):
        assert len(found) == 0


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("", "[sensors]\na = 1\n"),
        ("[bus]\nb = 2", "[bus]\nb = 2\n\n[sensors]\na = 1\n"),
        ("[sensors]\na = 0\nc = 3\n[bus]\na = 5\n", "[sensors]\na = 1\nc = 3\n[bus]\na = 5\n"),
        ("[sensors]  # mine\nc = 3\n[bus]\na = 5\n", "[sensors]  # mine\na = 1\nc = 3\n[bus]\na = 5\n"),
    ],
)
def test_a_line_goes_where_it_belongs(before: str, after: str) -> None:
    assert put_line(before, "a = 1") == after


def test_a_configuration_that_is_none_stays_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "bridge.toml"
    path.write_text("[sensors\n")
    with pytest.raises(InputError, match=r"bridge\.toml"):
        write_line(path, "gaze_offset_ms = 1.0")
    assert path.read_text() == "[sensors\n"
    with pytest.raises(InputError):
        write_line(tmp_path / "new.toml", "gaze_offset_ms = 9999.0")
    assert not (tmp_path / "new.toml").exists()


def test_the_command_writes_a_line_that_the_configuration_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, config = recorded(tmp_path, clapping(60.0)), tmp_path / "bridge.toml"
    monkeypatch.setattr("sys.argv", ["hilbridge", "align", str(path), "--by", "clap", "--write", str(config)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert said.startswith("inertial_offset_ms = -")
    assert load_config(config).sensors.inertial_offset_ms == pytest.approx(-60, abs=15)
