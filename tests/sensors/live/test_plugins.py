"""hilbridge.sensors.live.plugins: code of others is found by name, and what is wrong with it is one line."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from hilbridge.errors import InputError
from hilbridge.sensors.hands import open_own_detector
from hilbridge.sensors.live.base import LiveDevice
from hilbridge.sensors.live.lsl import LslChannels
from hilbridge.sensors.live.plugins import called, is_own, offered
from hilbridge.sensors.live.spec import is_live, open_live_gaze

TRACKER = """
from hilbridge.api import LiveGaze
class Tracker(LiveGaze):
    def __init__(self, where="here"):
        super().__init__(f"gaze {where}", None)
    def _read_all(self):
        pass
class Detector:
    def detect(self, frame):
        return None
def Fails():
    raise RuntimeError("no such port")
"""


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with somebody's module, which a package offers as well."""
    (tmp_path / "lab_of_mine.py").write_text(TRACKER)
    info = tmp_path / "lab_of_mine-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lab_of_mine\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[hilbridge.gaze]\nmytracker = lab_of_mine:Tracker\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "lab_of_mine", raising=False)
    return tmp_path


def test_a_class_is_named_with_what_it_is_called_with(lab: Path) -> None:
    assert open_live_gaze("lab_of_mine:Tracker", LslChannels(), 0).name == "gaze here"
    assert open_live_gaze("lab_of_mine:Tracker:COM3", LslChannels(), 0).name == "gaze COM3"


def test_a_package_offers_one_under_a_short_name(lab: Path) -> None:
    sys.path.insert(0, str(lab))
    assert "mytracker" in offered()
    assert is_live("mytracker:COM3")
    assert open_live_gaze("mytracker:COM3", LslChannels(), 0).name == "gaze COM3"


def test_files_and_built_in_sources_go_first(lab: Path) -> None:
    (lab / "odd:Name").write_text("")
    assert not is_own("odd:Name")
    assert not is_own("recording.csv")
    assert not is_own("sessions/P-07")
    assert open_live_gaze("udp:0:45678".replace("0:", "127.0.0.1:"), LslChannels(), 0).name.startswith("gaze udp")


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ("nobody.has_this:Tracker", "cannot be imported"),
        ("lab_of_mine:Traker", "did you mean `Tracker`"),
        ("lab_of_mine:Fails", "RuntimeError: no such port"),
        ("lab_of_mine:Detector", "makes a Detector, not a LiveDevice"),
        ("lab_of_mine:Tracker:a:b:c", None),
        ("not code", "names no code"),
    ],
)
def test_what_is_wrong_is_one_line(lab: Path, spec: str, said: str | None) -> None:
    if said is None:
        assert called("gaze", spec, LiveDevice).name == "gaze a:b:c"
        return
    with pytest.raises(InputError, match=said) as refused:
        called("gaze", spec, LiveDevice)
    assert "\n" not in str(refused.value)


def test_a_detector_has_to_detect(lab: Path) -> None:
    assert open_own_detector("lab_of_mine:Detector").detect(None) is None
    with pytest.raises(InputError, match="without `detect"):
        open_own_detector("lab_of_mine:Tracker")
