"""sensors.pictures.pyav: a played phone's scene camera over RTSP, stamped by the phone's reports on this computer's clock."""

from __future__ import annotations

import pytest

from hilbridge.config import SensorsConfig
from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.records import CameraFrame, StampSource
from hilbridge.runtime.senses import _refuse_to_guess, _scene_of
from hilbridge.sensors.camera import CameraSource
from hilbridge.sensors.live.neon import NeonGaze
from hilbridge.sensors.source import SourceState

pytest.importorskip("av")
pytest.importorskip("pupil_labs.realtime_api")
from tests.sensors.live.fake_neon import FakeNeon
from tests.sensors.live.test_neon import until


def test_a_neons_pictures_have_its_own_stamps_carried_to_this_clock() -> None:
    with FakeNeon(skew_ns=250 * MS) as phone:
        gaze = NeonGaze(f"127.0.0.1:{phone.port}")
        spec, clock = _scene_of(gaze, "neon:")
        assert spec == f"rtsp://127.0.0.1:{phone.rtsp_port}/?camera=world"
        assert clock is gaze.clock is not None
        camera, frames = CameraSource(spec, clock=clock), list[CameraFrame]()
        camera.on_value = frames.append
        gaze.start()
        camera.start()
        try:
            until(lambda: len([frame for frame in frames if frame.stamp is StampSource.RTCP]) > 20)
            phone.silent = True
            until(lambda: camera.state is SourceState.GONE)
            phone.silent = False
            before = len(frames)
            until(lambda: camera.state is SourceState.RUNNING and len(frames) > before + 5)
        finally:
            camera.stop(10.0)
            gaze.stop(10.0)
        taken_ns = list(phone.pictures_ns)
    off_ns = [
        min(abs(frame.captured_ns - at_ns) for at_ns in taken_ns)
        for frame in frames[:before]
        if frame.stamp is StampSource.RTCP
    ]
    assert sorted(off_ns)[len(off_ns) // 2] < 5 * MS
    assert (camera.width, camera.height) == (128, 96)


def test_neon_as_camera_needs_the_glasses_as_gaze() -> None:
    with pytest.raises(InputError, match="camera neon:: is the scene camera of the glasses"):
        _refuse_to_guess(SensorsConfig(camera="neon:", gaze="udp:7000"))
    _refuse_to_guess(SensorsConfig(camera="neon:", gaze="neon:"))
    assert _scene_of(None, "0") == ("0", None)
