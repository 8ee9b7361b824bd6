"""Sensors on the body beside camera and eye tracker: inertial ones for the tremor guard, a skeleton whose wrists are hands."""

from __future__ import annotations

import time
from collections.abc import Callable

from hilbridge.config import SensorsConfig
from hilbridge.errors import InputError
from hilbridge.features.wrists import Projection, WristHands, projection_of
from hilbridge.intent.acceleration import AccelerationGuard
from hilbridge.records import BodySample
from hilbridge.rows import InertialRow, SkeletonRow
from hilbridge.runtime.health import SensorSeen, inertial_seen
from hilbridge.sensors.source import Source, SourceState

Kind = type[InertialRow] | type[SkeletonRow]


class BodySenses:
    """Either source may be None. `felt` and `wrists` are what is made of them; `on_sample` is told each, in its thread."""

    def __init__(
        self,
        inertial: Source[BodySample] | None = None,
        skeleton: Source[BodySample] | None = None,
        projection: Projection | None = None,
    ) -> None:
        self.inertial, self.skeleton = inertial, skeleton
        self.felt = None if inertial is None else AccelerationGuard()
        self.wrists = None if skeleton is None or projection is None else WristHands(projection)
        self.on_sample: Callable[[Kind, BodySample], None] = lambda kind, sample: None
        if inertial is not None:
            inertial.on_value = self._feel
        if skeleton is not None:
            skeleton.on_value = self._place

    @property
    def sources(self) -> dict[str, Source[BodySample]]:
        """Those that there are, by their names in accounts."""
        given = {"inertial": self.inertial, "skeleton": self.skeleton}
        return {name: source for name, source in given.items() if source is not None}

    @property
    def ended(self) -> bool:
        """True when a recording was played to its end."""
        return any(source.state is SourceState.ENDED for source in self.sources.values())

    def seen(self, config: SensorsConfig) -> tuple[SensorSeen, ...]:
        """What they last said. A silent skeleton is hands that nobody sees, and no reason to hold."""
        if self.inertial is None or self.felt is None:
            return ()
        running = self.inertial.state is SourceState.RUNNING
        return (inertial_seen(config, running, self.felt.heard_ns, live=self.inertial.live),)

    def _feel(self, sample: BodySample) -> None:
        assert self.felt is not None
        assert self.inertial is not None
        self.felt.update(sample)
        self.inertial.cell.take()
        self.on_sample(InertialRow, sample)

    def _place(self, sample: BodySample) -> None:
        assert self.skeleton is not None
        if self.wrists is not None:
            self.wrists.put(sample)
        self.skeleton.cell.take()
        self.on_sample(SkeletonRow, sample)


def body_projection(config: SensorsConfig) -> Projection | None:
    """How a skeleton gets into the picture. Raises InputError where a skeleton is asked for and nothing says."""
    if config.skeleton is None:
        return None
    if config.skeleton_projection is None:
        raise InputError(
            f"skeleton {config.skeleton}: nothing says where its places lie in the camera's picture; set "
            "skeleton_projection in [sensors] (docs/live-gaze.md)"
        )
    return projection_of(config.skeleton_projection)


def open_body(
    what: str,
    spec: str,
    *,
    loop: bool = False,
    offset_ns: int = 0,
    clock_ns: Callable[[], int] = time.monotonic_ns,
) -> Source[BodySample]:
    """The source that a spec names (`what`: inertial, skeleton), not started. Raises InputError.

    offset_ns: added to its stamps.
    """
    from pathlib import Path

    from hilbridge.sensors.live.spec import is_live, open_live_body
    from hilbridge.sensors.recorded.body import BodyPlayer, BodyRecording

    if is_live(spec):
        device = open_live_body(what, spec, {"inertial": "HAND", "skeleton": "WRIST"}[what])
        device.offset_ns = offset_ns
        return device
    return BodyPlayer(what, BodyRecording(what, Path(spec), offset_ns), loop=loop, clock_ns=clock_ns)
