"""sensors.recorded.body: inertial sensors and skeleton of a made recording, in step with its gaze."""

from __future__ import annotations

from pathlib import Path

import pytest

from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.records import BodySample
from hilbridge.sensors.recorded.body import BodyPlayer, BodyRecording
from hilbridge.sensors.source import SourceState

pytest.importorskip("h5py")
from tests.sensors.recorded.test_iassistadl import make


@pytest.mark.parametrize("off_s", [0.0, 0.3, -0.3])
@pytest.mark.parametrize("what", ["inertial", "skeleton"])
def test_samples_are_on_the_gazes_clock_within_five_milliseconds(tmp_path: Path, what: str, off_s: float) -> None:
    samples = list(BodyRecording(what, make(tmp_path / "one", inertial_off_s=off_s, lose=7)).samples())
    period_ns = 10 * MS if what == "inertial" else 10**9 // 30
    late = [(sample.captured_ns + period_ns // 2) % period_ns - period_ns // 2 for sample in samples]
    assert max(map(abs, late)) < 5 * MS
    assert samples == sorted(samples, key=lambda sample: sample.captured_ns)
    assert {sample.sensor for sample in samples} == ({"HAND_R", "FOREARM_R"} if what == "inertial" else {"RIGHT_WRIST"})


def test_a_folder_without_is_one_line(tmp_path: Path) -> None:
    folder = make(tmp_path / "one")
    (folder / "xsense.h5").unlink()
    with pytest.raises(InputError, match=r"has no xsense\.h5"):
        BodyRecording("inertial", folder)
    with pytest.raises(InputError, match="no such folder"):
        BodyRecording("skeleton", tmp_path / "two")


def test_it_is_played_and_ends(tmp_path: Path) -> None:
    recording = BodyRecording("inertial", make(tmp_path / "one"))
    now_ns = [10**12]

    def clock_ns() -> int:
        now_ns[0] += 100 * MS  # nothing has to be waited for
        return now_ns[0]

    heard: list[BodySample] = []
    player = BodyPlayer("inertial", recording, clock_ns=clock_ns)
    player.on_value = heard.append
    player.start()
    player._thread.join(20.0)
    assert player.state is SourceState.ENDED
    assert len(heard) == 2000
    assert heard[-1].captured_ns - heard[0].captured_ns == pytest.approx(9990 * MS, abs=5 * MS)
