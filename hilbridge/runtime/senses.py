"""Camera, gaze, sensors on the body and the vision worker as one thing that is started, asked and stopped together."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from hilbridge.config import SensorsConfig
from hilbridge.errors import InputError
from hilbridge.features.lens import GazeMap, lens_of
from hilbridge.features.plane import homography_of
from hilbridge.limits import MS
from hilbridge.records import CameraFrame, FeatureVector, GazeSample
from hilbridge.rows import ClockRow, SourceAccount
from hilbridge.runtime.body import BodySenses, body_projection, open_body
from hilbridge.runtime.health import SensorSeen, camera_seen, gaze_seen, hands_seen
from hilbridge.runtime.vision import FindsHands, VisionWorker
from hilbridge.sensors.clock import DeviceClock
from hilbridge.sensors.source import Source, SourceState

SCENE = "neon:"  # as --camera: the scene camera of the glasses that --gaze names

if TYPE_CHECKING:
    from hilbridge.sensors.live.base import LiveGaze


class Senses:
    """What the wearer does, as the bridge perceives it. `vectors` holds the newest features."""

    def __init__(
        self,
        camera: Source[CameraFrame],
        gaze: Source[GazeSample] | None,
        find_hands: Callable[[], FindsHands] | None,
        *,
        camera_fps: float,
        config: SensorsConfig,
        body: BodySenses | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.camera, self.gaze, self.camera_fps = camera, gaze, camera_fps
        self.vision = VisionWorker(camera.cell, gaze.cell if gaze else None, find_hands, clock_ns)
        self.body = body or BodySenses()
        self.vision.wrists = self.body.wrists
        self._config = config

    @property
    def devices(self) -> tuple[Source[Any], ...]:
        """The sources that run beside the camera, each by itself."""
        return (*([] if self.gaze is None else [self.gaze]), *self.body.sources.values())

    def start(self) -> None:
        """Start the worker first, so that a slow detector does not make the first pictures old."""
        self.vision.start()
        self.vision.ready.wait(60.0)
        if isinstance(self.vision.failure, InputError):
            raise self.vision.failure
        self.camera.start()
        for device in self.devices:
            device.start()

    def stop(self) -> None:
        self.camera.stop()
        for device in self.devices:
            device.stop()
        self.vision.stop()

    def take(self) -> FeatureVector | None:
        """The newest features not yet taken."""
        return self.vision.vectors.take()

    @property
    def ended(self) -> bool:
        """True when a recording was played to its end."""
        gaze_ended = self.gaze is not None and self.gaze.state is SourceState.ENDED
        return gaze_ended or self.body.ended or self.camera.state is SourceState.ENDED

    def seen(self) -> tuple[SensorSeen, ...]:
        """What each source last said, for `health`."""
        config, vision = self._config, self.vision
        looks = self.camera.state is SourceState.RUNNING and vision.failure is None
        camera = camera_seen(config, looks, self.camera.last_captured_ns, vision.freeze.changed_ns)
        seen, gaze = [camera], self.gaze
        if gaze is not None:
            running = gaze.state is SourceState.RUNNING
            seen.append(gaze_seen(config, running, gaze.last_captured_ns, live=gaze.live))
        if vision.hands_alive is not None:
            seen.append(hands_seen(config, vision.hands_alive, vision.hands_ns))
        return (*seen, *self.body.seen(config))

    def clocks(self, now_ns: int) -> tuple[ClockRow, ...]:
        """What is known of the clocks of devices that have their own."""
        rows = []
        for device in self.devices:
            clock: DeviceClock | None = getattr(device, "clock", None)
            fit = None if clock is None else clock.fit
            if clock is None or fit is None:
                continue
            bound_ms, residual_ms = fit.bound_ns(now_ns) / MS, fit.residual_ns / MS
            offset_ns = fit.offset_at(now_ns)
            rows.append(
                ClockRow(now_ns, device.name, offset_ns, fit.drift_ppm, residual_ms, bound_ms, fit.probes, clock.steps)
            )
        return tuple(rows)

    def accounts(self) -> dict[str, SourceAccount]:
        """Every value of every cell and what became of it."""
        cells: dict[str, Any] = {"camera": self.camera.cell, "features": self.vision.vectors}
        if self.gaze is not None:
            cells["gaze"] = self.gaze.cell
        cells |= {name: source.cell for name, source in self.body.sources.items()}
        accounts: dict[str, SourceAccount] = {}
        for name, cell in cells.items():
            counts = cell.counts()
            with_hands = self.vision.frames_with_hands if name == "camera" else None
            accounts[name] = SourceAccount(
                counts.received, counts.used, counts.overwritten, counts.failed, counts.pending, with_hands
            )
        return accounts


def open_tracker(config: SensorsConfig) -> LiveGaze:
    """The live eye tracker of a configuration. Raises InputError."""
    from hilbridge.sensors.live.lsl import LslChannels
    from hilbridge.sensors.live.spec import open_live_gaze

    assert config.gaze is not None
    tracker = open_live_gaze(config.gaze, LslChannels(**config.lsl.model_dump()), round(config.gaze_latency_ms * MS))
    tracker.offset_ns = round(config.gaze_offset_ms * MS)
    return tracker


def gaze_map(config: SensorsConfig) -> GazeMap | None:
    """How gaze gets into the camera's picture; None where both are one. Raises InputError."""
    plane = None if config.gaze_homography is None else homography_of(config.gaze_homography)
    lenses = [
        None if lens is None else lens_of(key, (lens.width, lens.height), lens.matrix, lens.distortion)
        for key, lens in (("gaze_lens", config.gaze_lens), ("camera_lens", config.camera_lens))
    ]
    if plane is None and not config.gaze_same_camera and any(lenses):
        raise InputError(
            "gaze_lens, camera_lens: straighten pictures, but not which of them lies where in the other; "
            "set gaze_homography (of straightened pictures) or gaze_same_camera = true"
        )
    return GazeMap(lenses[0], plane, lenses[1]) if plane is not None or any(lenses) else None


def _host_of(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:  # brackets of an address that is none
        return None


def _refuse_to_guess(config: SensorsConfig) -> None:
    """Gaze of a Neon is of its own scene camera. In another camera's picture it would point at the wrong thing."""
    kind, _, host = (config.gaze or "").partition(":")
    if config.camera == SCENE and kind != "neon":
        raise InputError(
            f"camera {SCENE}: is the scene camera of the glasses in --gaze neon:, and gaze is {config.gaze}"
        )
    if kind != "neon" or config.gaze_homography is not None or config.gaze_same_camera:
        return
    host = host.partition(":")[0]
    if config.camera == SCENE:
        return
    if not host or _host_of(config.camera or "") != host:
        raise InputError(
            f"gaze {config.gaze}: is of the glasses' own scene camera, and nothing says that --camera {config.camera} shows "
            "its picture; set gaze_same_camera = true or gaze_homography in [sensors] (docs/live-gaze.md)"
        )


def _scene_of(tracker: LiveGaze | None, camera: str) -> tuple[str, DeviceClock | None]:
    """What `camera` is, and the clock of its stamps where the eye tracker has the same. Raises InputError."""
    from hilbridge.sensors.live.neon import NeonGaze

    if not isinstance(tracker, NeonGaze):
        return camera, None
    scene = tracker.glasses.scene_url
    if camera == SCENE:
        if scene is None:
            raise InputError(f"camera {SCENE}: the phone says that no scene camera is connected; look at the glasses")
        return scene, tracker.clock
    return camera, tracker.clock if scene is not None and _host_of(scene) == _host_of(camera) else None


def open_senses(config: SensorsConfig) -> Senses:
    """Open what the configuration names. Raises InputError naming the first thing that is not there, and the cure."""
    from hilbridge.sensors.camera import CameraSource
    from hilbridge.sensors.gaze import GazePlayer, open_gaze
    from hilbridge.sensors.live.spec import is_live
    from hilbridge.sensors.models import hand_model_path, load_hand_model
    from hilbridge.sensors.pictures.capture import Reader

    if config.camera is None:
        raise InputError("no camera is given; add --camera INDEX|FILE|URL (or [sensors] camera in bridge.toml)")
    # Cheap checks first: nothing is started, and no device taken, for a run that cannot begin.
    carried = gaze_map(config)
    _refuse_to_guess(config)
    projection = body_projection(config)
    live = config.gaze is not None and is_live(config.gaze)
    recording = open_gaze(Path(config.gaze)) if config.gaze is not None and not live else None
    model = Path(config.hand_model) if config.hand_model is not None else hand_model_path()
    if config.hands and config.hand_detector is None:
        try:
            load_hand_model(model, config.hand_model_sha256)
        except InputError as error:
            raise InputError(f"{error}, or give --no-hands") from None

    def find_hands() -> FindsHands:
        from hilbridge.sensors.hands import open_detector, open_own_detector
        from hilbridge.sensors.hands_apart import HandsApart

        if config.hand_detector is not None:
            return HandsApart(open_own_detector, config.hand_detector)
        return HandsApart(open_detector, model, config.hand_model_sha256)

    gaze: Source[GazeSample] | None = None
    tracker: LiveGaze | None = None
    if recording is not None:
        offset_ns = round(config.gaze_offset_ms * MS)
        gaze = GazePlayer(replace(recording, time_ns=recording.time_ns + offset_ns), loop=config.loop)
    elif config.gaze is not None:
        gaze = tracker = open_tracker(config)
    spec, clock = _scene_of(tracker, config.camera)
    camera = CameraSource(
        spec,
        loop=config.loop,
        fps=config.camera_fps,
        latency_ns=round(config.camera_latency_ms * MS),
        reader=Reader(config.camera_reader),
        clock=clock,
    )
    if gaze is not None and carried is not None:
        gaze.adjust = carried.sample
    inertial, felt_ns = None, round(config.inertial_offset_ms * MS)
    if config.inertial is not None:
        inertial = open_body("inertial", config.inertial, loop=config.loop, offset_ns=felt_ns)
    skeleton = None if config.skeleton is None else open_body("skeleton", config.skeleton, loop=config.loop)
    body = BodySenses(inertial, skeleton, projection)
    return Senses(camera, gaze, find_hands if config.hands else None, camera_fps=camera.fps, config=config, body=body)
