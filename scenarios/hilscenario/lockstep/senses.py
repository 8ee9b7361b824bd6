"""Camera, eye tracker and vision worker in virtual time."""

from __future__ import annotations

from collections.abc import Callable

from hilbridge.config import SensorsConfig
from hilbridge.features.assembler import FeatureAssembler
from hilbridge.intent.acceleration import AccelerationGuard
from hilbridge.records import BodySample, CameraFrame, FeatureVector, GazeSample, HandTracks
from hilbridge.rows import InertialRow, Look, Row, body_row, features_row, gaze_row, hands_row
from hilbridge.runtime.health import FreezeProbe, SensorSeen, camera_seen, gaze_seen, inertial_seen
from hilscenario.format.schema import Scenario
from hilscenario.lockstep.clock import WorldClock
from hilscenario.world.fault_board import FaultBoard
from hilscenario.world.recorded import Worn
from hilscenario.world.sensing import CAMERA_PERIOD_NS, GAZE_PERIOD_NS, Body, detected, edges

VISION_NS = 12_000_000  # from a picture's capture to its features, as measured in live runs
_FEEL_NS = 10_000_000  # inertial samples of so long are handed over together
_LIMITS = SensorsConfig()


class Sight:
    """The sensor data of one bridge process. A restarted process has a new one. `record` is None where nobody does."""

    def __init__(self, assembler: FeatureAssembler, record: Callable[[Row], None] | None = None) -> None:
        self._assembler, self._record = assembler, record
        self._sample: GazeSample | None = None
        self._vector: FeatureVector | None = None
        self._camera_ns: int | None = None
        self._gaze_ns: int | None = None
        self._freeze = FreezeProbe()
        self._felt: AccelerationGuard | None = None

    def take_frame(self, frame: CameraFrame, hands: HandTracks | None, now_ns: int) -> None:
        """The vision worker's step: a picture and the newest gaze become features."""
        self._freeze.look(frame)
        self._camera_ns = frame.captured_ns
        sample, self._sample = self._sample, None
        self._vector = self._assembler.update(frame, sample, hands, frame.captured_ns)
        if self._record is not None:
            if hands is not None:
                self._record(hands_row(hands, now_ns))
            self._record(features_row(Look(now_ns, self._vector, frame.sequence, sample, hands)))

    def take_gaze(self, sample: GazeSample, now_ns: int) -> None:
        """The newest point of regard."""
        self._sample, self._gaze_ns = sample, sample.captured_ns
        if self._record is not None:
            self._record(gaze_row(sample, now_ns))

    def take_body(self, sample: BodySample, now_ns: int) -> None:
        """What an inertial sensor felt."""
        self._felt = self._felt or AccelerationGuard()
        self._felt.update(sample)
        if self._record is not None:
            self._record(body_row(InertialRow, sample, now_ns))

    @property
    def shaking(self) -> bool | None:
        """Whether the hands feel a tremor; None where nobody feels them."""
        return None if self._felt is None else self._felt.trembling

    def take_vector(self) -> FeatureVector | None:
        """The newest features, if they were not taken yet."""
        vector, self._vector = self._vector, None
        return vector

    def seen(self) -> tuple[SensorSeen, ...]:
        """What each source last said, for `runtime.health`."""
        return (
            camera_seen(_LIMITS, True, self._camera_ns, self._freeze.changed_ns),
            gaze_seen(_LIMITS, True, self._gaze_ns),
            *(() if self._felt is None else (inertial_seen(_LIMITS, True, self._felt.heard_ns),)),
        )


class VirtualSenses:
    """The sensors on the clock. They deliver to `sight` while `is_running` says that somebody is there to take it."""

    def __init__(
        self, scenario: Scenario, clock: WorldClock, board: FaultBoard, body: Body, is_running: Callable[[], bool]
    ) -> None:
        self._clock, self._body, self._is_running = clock, body, is_running
        self._camera, self._gaze, self._hands = edges(body, board, scenario.seed)
        self.sight: Sight | None = None

    def start(self) -> None:
        """Plan the first of everything."""
        self._clock.at(0, self._look)
        self._clock.at(0, self._glance)
        if isinstance(self._body.calm, Worn) and self._body.calm.felt:
            self._clock.at(0, self._feel)

    def _look(self) -> None:
        now_ns, sight = self._clock.time_ns, self.sight
        self._clock.at(now_ns + CAMERA_PERIOD_NS, self._look)
        if (delivered := self._camera.deliver(now_ns)) is not None:
            arrives_ns, frame = delivered
            self._clock.at(arrives_ns + VISION_NS, lambda: self.see(frame, sight))

    def see(self, frame: CameraFrame, sight: Sight | None) -> None:
        """A picture goes to the process that ran when it was taken, or to none."""
        if sight is not None and sight is self.sight and self._is_running():
            hands = detected(self._hands, self._body, frame.captured_ns)
            sight.take_frame(frame, hands, self._clock.time_ns)

    def _glance(self) -> None:
        now_ns, sight = self._clock.time_ns, self.sight
        self._clock.at(now_ns + GAZE_PERIOD_NS, self._glance)
        if (delivered := self._gaze.deliver(now_ns)) is not None:
            arrives_ns, sample = delivered
            self._clock.at(arrives_ns, lambda: self._note_gaze(sample, sight))

    def _feel(self) -> None:
        now_ns, sight, worn = self._clock.time_ns, self.sight, self._body.calm
        self._clock.at(now_ns + _FEEL_NS, self._feel)
        if sight is not None and self._is_running() and isinstance(worn, Worn):
            for sample in worn.felt_between(now_ns - _FEEL_NS, now_ns):
                sight.take_body(sample, now_ns)

    def _note_gaze(self, sample: GazeSample, sight: Sight | None) -> None:
        if sight is not None and sight is self.sight and self._is_running():
            sight.take_gaze(sample, self._clock.time_ns)
