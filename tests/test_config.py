"""config: defaults, what the command line adds, and one-line refusals that name file, key and cure."""

from __future__ import annotations

from pathlib import Path

import pytest

from hilbridge.config import Config, load_config
from hilbridge.errors import InputError


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "bridge.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_nothing_given_is_the_default() -> None:
    assert load_config(None) == Config()
    assert Config().bus.spec == "auto"
    assert Config().bus.arm is False


def test_the_command_line_wins_over_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, '[sensors]\ncamera = "0"\ngaze = "a.csv"\n[gate]\ntau_on = 0.9\n')
    config = load_config(path, {"sensors": {"camera": "clip.mp4", "gaze": None}, "bus": {"spec": "vcan0"}})
    assert (config.sensors.camera, config.sensors.gaze) == ("clip.mp4", "a.csv")
    assert (config.bus.spec, config.gate.tau_on) == ("vcan0", 0.9)


def test_bus_options_are_laid_over_key_by_key(tmp_path: Path) -> None:
    path = written(tmp_path, "[bus]\noptions = { bitrate = 250000, fd = true }\n")
    config = load_config(path, {"bus": {"options": {"bitrate": 500_000}}})
    assert config.bus.options == {"bitrate": 500_000, "fd": True}
    assert load_config(path, {"bus": {"options": None}}).bus.options["bitrate"] == 250_000


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[sensor]\n", "unknown key `sensor`; did you mean `sensors`?"),
        ("[sensors]\ncamra = '0'\n", "unknown key `sensors.camra`; did you mean `camera`?"),
        ("[bus]\nzzz = 1\n", "unknown key `bus.zzz`; known here: spec, options, dbc"),
        ("[gate]\ntau_on = 1.5\n", "`gate.tau_on` = 1.5"),
        ("[gate]\ntau_on = nan\n", "`gate.tau_on` = nan"),
        ("[gate]\ntau_on = 0.5\ntau_off = 0.5\n", "tau_off = 0.5 must be below tau_on = 0.5"),
        ("[gate]\nmax_age_ms = 151\n", "`gate.max_age_ms` = 151"),
        ("[sensors]\ncamera_timeout_ms = 0\n", "`sensors.camera_timeout_ms` = 0"),
        ("[sensors]\ngaze_timeout_ms = 100000\n", "`sensors.gaze_timeout_ms` = 100000"),
        ("[bus]\narm = 'yes'\n", "`bus.arm` = 'yes'"),
        ("sensors = 3\n", "`sensors` = 3"),
        ("[gate\n", "not readable as TOML"),
    ],
)
def test_refusals_name_file_key_and_cure(tmp_path: Path, text: str, said: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InputError) as refused:
        load_config(path)
    assert str(path) in str(refused.value)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_absent_and_binary_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_config(tmp_path / "none.toml")
    binary = tmp_path / "b.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not readable as TOML"):
        load_config(binary)
