"""What camera, eye tracker and hand detector deliver, with every fault of the vocabulary at the sensor's edge.

Pure functions of time and of the faults under way: the lockstep engine and the live bridge call the same code.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from hilbridge.records import CameraFrame, GazeSample, Hand, HandTracks
from hilbridge.wearer.person import Wearer
from hilbridge.wearer.shaking import Tremor
from hilbridge.wearer.timeline import BENCHMARK, DEMO
from hilscenario.format.schema import Scenario, Session
from hilscenario.world.fault_board import Active, FaultBoard
from hilscenario.world.recorded import Filmed, Person
from hilscenario.world.replayed import recorded_person

T = TypeVar("T", CameraFrame, GazeSample, HandTracks)

WIDTH_PX, HEIGHT_PX = 96, 72
CAMERA_PERIOD_NS = 40_000_000
GAZE_PERIOD_NS = 20_000_000
_KINDS = ("off", "slow", "intermittent", "stuck", "wrong", "garbage", "drift", "delayed", "clock_skew")


def person(scenario: Scenario, tremor: Tremor | None = None) -> Person:
    """The scenario's wearer. Equal seeds are equal people, so that each thread may have its own copy.

    Raises InputError where it is a recorded session that cannot be read.
    """
    if (recorded := recorded_person(scenario)) is not None:
        return recorded
    seed = scenario.seed if scenario.wearer.seed is None else scenario.wearer.seed
    difficulty = BENCHMARK if scenario.wearer.difficulty == "benchmark" else DEMO
    return Wearer(seed, difficulty=difficulty, tremor=tremor, width_px=WIDTH_PX, height_px=HEIGHT_PX)


class Body:
    """The wearer as the world sees them, faults of the wearer's own included. Times are the wearer's."""

    def __init__(self, scenario: Scenario, board: FaultBoard, wearer: Person | None = None) -> None:
        """`wearer`: somebody else than the scenario's; no fault of the wearer's own changes them."""
        self._scenario, self._board = scenario, board
        self.calm = wearer or person(scenario)
        self._shaking: dict[Active, Person] = {}
        # A recorded camera has no hands where none are looked for.
        self.has_hands = (
            not isinstance(scenario.intent, Session)
            or scenario.intent.hands
            or (scenario.intent.video is None and scenario.intent.folder is None)
            or scenario.intent.projection is not None
        )
        self._flicker = np.random.default_rng(scenario.seed).integers(0, 8, WIDTH_PX * HEIGHT_PX + 251, np.uint8)

    def close(self) -> None:
        """What a recorded wearer holds open."""
        if isinstance(self.calm, Filmed):
            self.calm.close()

    def _wearer(self) -> Person:
        tremor = self._board.get("wearer.tremor")
        if tremor is None:
            return self.calm
        tremor.took_effect()
        for active, wearer in self._shaking.items():
            if active is tremor:
                return wearer
        made = person(self._scenario, Tremor(tremor["hz"], tremor["amplitude"], tremor["arm_deg"]))
        self._shaking[tremor] = made
        return made

    def frame(self, t_ns: int) -> CameraFrame:
        """The picture, with the flicker of a real sensor's lowest bit, so that a wearer at rest is no frozen camera."""
        frame = self._wearer().frame(t_ns)
        if frame.palette is None:  # filmed, not drawn: a recorded camera has its own noise
            return frame
        shift = frame.sequence % 251
        flicker = self._flicker[shift : shift + frame.pixels.size].reshape(frame.pixels.shape)
        palette = _flickering(frame.palette.tobytes())
        return CameraFrame(t_ns, frame.pixels << 3 | flicker, frame.sequence, frame.stamp, palette)

    def gaze(self, t_ns: int) -> GazeSample:
        """The point of regard; shut or averted eyes are the wearer's faults."""
        sample = self.calm.gaze(t_ns)
        if (blink := self._board.get("wearer.blink")) is not None:
            blink.took_effect()
            return replace(sample, valid=False)
        if (away := self._board.get("wearer.look_away")) is not None:
            away.took_effect()
            return replace(sample, x=1.4, y=1.3)
        return sample

    def hands(self, t_ns: int) -> HandTracks:
        """The palms as the detector gives them."""
        if (hidden := self._board.get("wearer.hands_out_of_view")) is not None:
            hidden.took_effect()
            return HandTracks(t_ns, ())
        tracks = self._wearer().hands(t_ns)
        if (ataxia := self._board.get("wearer.ataxia")) is not None:
            ataxia.took_effect()
            dx, dy = _wander(ataxia["amplitude"], t_ns)
            moved = tuple(replace(hand, x=hand.x + dx, y=hand.y + dy) for hand in tracks.hands)
            return replace(tracks, hands=moved)
        return tracks


@lru_cache(maxsize=8)
def _flickering(palette: bytes) -> NDArray[np.uint8]:
    """RGB bytes -> each colour eight times over: with the lowest bits of red, green and blue as they are, or turned."""
    colours = np.frombuffer(palette, np.uint8).reshape(-1, 1, 3)
    turned = (np.arange(8)[:, None] >> np.arange(3) & 1).astype(np.uint8)
    return (colours ^ turned).reshape(-1, 3)


def _wander(amplitude: float, t_ns: int) -> tuple[float, float]:
    """Irregular overshoot: sines of 0.7 to 2.3 Hz that never line up."""
    t_s = t_ns * 1e-9
    x = 0.6 * math.sin(2 * math.pi * 0.73 * t_s) + 0.4 * math.sin(2 * math.pi * 1.9 * t_s + 1.0)
    y = 0.6 * math.sin(2 * math.pi * 0.91 * t_s + 2.0) + 0.4 * math.sin(2 * math.pi * 2.3 * t_s)
    return amplitude * x, amplitude * y


class SensorEdge(Generic[T]):
    """One sensor: asked once per period, gives what it delivers and when.

    name: `camera`, `gaze` or `hands`. observe: content at a time. spoil: a content no sensor could see.
    drift: (content, how far) -> content.
    """

    def __init__(
        self,
        name: str,
        board: FaultBoard,
        observe: Callable[[int], T],
        spoil: Callable[[T, random.Random], T],
        drift: Callable[[T, float], T],
        seed: int,
    ) -> None:
        self.name = name
        self._board = board
        self._observe: Callable[[int], T] = observe
        self._spoil: Callable[[T, random.Random], T] = spoil
        self._drift: Callable[[T, float], T] = drift
        self._names = tuple(f"{name}.{kind}" for kind in _KINDS)
        self._random = random.Random(f"{seed}.{name}")
        self._last: T | None = None
        self._count = 0

    def deliver(self, t_ns: int) -> tuple[int, T] | None:
        """What leaves the sensor for the moment `t_ns`: (when it arrives, content with its stamp), or None."""
        self._count += 1
        if self._board.quiet:
            self._last = self._observe(t_ns)
            return t_ns, self._last
        off, slow, intermittent, stuck, wrong, garbage, drift, delayed, skew = map(self._board.get, self._names)
        if off is not None:
            off.took_effect()
            return None
        if slow is not None and self._count % round(slow["keep_every"]):
            slow.took_effect()
            return None
        if intermittent is not None and self._random.random() < intermittent["loss"]:
            intermittent.took_effect()
            return None
        value = self._content(t_ns, stuck, wrong, garbage, drift)
        arrives_ns = t_ns
        if skew is not None:
            skew.took_effect()
            value = replace(value, captured_ns=value.captured_ns + round(skew["skew_ms"] * 1e6))
        if delayed is not None:
            delayed.took_effect()
            arrives_ns += round(delayed["delay_ms"] * 1e6)
        return arrives_ns, value

    def _content(
        self, t_ns: int, stuck: Active | None, wrong: Active | None, garbage: Active | None, drift: Active | None
    ) -> T:
        if stuck is not None and self._last is not None:
            stuck.took_effect()
            return replace(self._last, captured_ns=t_ns)
        if wrong is not None:
            wrong.took_effect()
            value = replace(self._observe(t_ns + round(wrong["shift_s"] * 1e9)), captured_ns=t_ns)
        else:
            value = self._observe(t_ns)
        self._last = value
        if garbage is not None:
            garbage.took_effect()
            value = self._spoil(value, self._random)
        if drift is not None:
            drift.took_effect()
            value = self._drift(value, drift["per_s"] * (t_ns - drift.from_ns) * 1e-9)
        return value


def spoil_frame(frame: CameraFrame, chance: random.Random) -> CameraFrame:
    """A picture of noise."""
    noise = np.random.default_rng(chance.getrandbits(32)).integers(0, 256, frame.rgb.shape, np.uint8)
    return replace(frame, pixels=noise, palette=None)


def spoil_gaze(sample: GazeSample, chance: random.Random) -> GazeSample:
    """Numbers no eye tracker could mean."""
    return replace(sample, x=chance.choice((math.nan, math.inf, -1e30, 7e8)), y=math.nan, valid=True)


def spoil_hands(tracks: HandTracks, chance: random.Random) -> HandTracks:
    """Hands nobody has: NaN, huge, and more of them than arms."""
    odd = (math.nan, math.inf, -1e30, 7e8, chance.random())
    return replace(
        tracks, hands=tuple(Hand(chance.choice(odd), chance.choice(odd), chance.choice(odd)) for _ in range(5))
    )


def darken(frame: CameraFrame, amount: float) -> CameraFrame:
    """A lens that clouds over: brightness falls by `amount`."""
    return replace(frame, pixels=(frame.rgb * max(0.0, 1.0 - amount)).astype(np.uint8), palette=None)


def shift_gaze(sample: GazeSample, amount: float) -> GazeSample:
    """A tracker that slips to the right."""
    return replace(sample, x=sample.x + amount)


def shift_hands(tracks: HandTracks, amount: float) -> HandTracks:
    """Detections that slip to the right."""
    return replace(tracks, hands=tuple(replace(hand, x=hand.x + amount) for hand in tracks.hands))


def detected(edge: SensorEdge[HandTracks], body: Body, captured_ns: int) -> HandTracks | None:
    """What the detector finds in the picture of `captured_ns`; None where it gives nothing, or there is none."""
    if not body.has_hands:
        return None
    found = edge.deliver(max(0, captured_ns))
    if found is None:
        return None
    late_ns, hands = found[0] - captured_ns, found[1]
    if late_ns > 0:  # a detector that lags: it tells of an earlier picture
        hands = HandTracks(captured_ns - late_ns, body.hands(max(0, captured_ns - late_ns)).hands)
    return hands


def edges(
    body: Body, board: FaultBoard, seed: int
) -> tuple[SensorEdge[CameraFrame], SensorEdge[GazeSample], SensorEdge[HandTracks]]:
    """Camera, gaze and hands of one wearer."""
    return (
        SensorEdge("camera", board, body.frame, spoil_frame, darken, seed),
        SensorEdge("gaze", board, body.gaze, spoil_gaze, shift_gaze, seed),
        SensorEdge("hands", board, body.hands, spoil_hands, shift_hands, seed),
    )
