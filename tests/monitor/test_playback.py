import pytest

from hilbridge.errors import InputError
from hilbridge.monitor.playback import Playback
from tests.labels.made import recording


def test_a_moment_has_state_events_and_picture(tmp_path):
    played = Playback(recording(tmp_path / "recording.mcap"))
    assert played.length_s == pytest.approx(149 * 0.04, abs=0.05)
    view = played.view(3.0)
    assert view["s"] == 3.0
    assert view["state"]["word"] == "NO DEVICE"
    assert played.picture(1.0).jpeg[:2] == b"\xff\xd8"
    assert played.picture(-5.0) is None or played.picture(-5.0).jpeg[:2] == b"\xff\xd8"
    assert played.view(1e9)["s"] == pytest.approx(played.length_s, abs=0.01)


@pytest.mark.parametrize("content", [b"", b"no recording"])
def test_what_is_no_recording_is_refused(tmp_path, content):
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match="recording"):
        Playback(path)
