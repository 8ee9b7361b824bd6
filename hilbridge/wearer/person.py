"""The simulated wearer: gaze, hands, camera picture and arm intention as pure functions of time.

The same seed and the same `t_ns` give the same records in any order of asking. A seed is a person: the kitchen, the
light, the eyes and the way of reaching differ between seeds (subject shift) and stay the same within one.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hilbridge.core.right import is_right
from hilbridge.limits import MS
from hilbridge.records import CameraFrame, GazeSample, Hand, HandTracks, StampSource
from hilbridge.wearer.noise import Noise
from hilbridge.wearer.render import Scene, draw
from hilbridge.wearer.shaking import Shaking, Tremor
from hilbridge.wearer.timeline import COLOURS, DEMO, Difficulty, Event, Timeline

Point = tuple[float, float]

BLEND_NS = 600 * MS
REST: tuple[Point, Point] = ((0.30, 0.92), (0.70, 0.92))
# Where left and right hand go, None: stays at rest.
REACH: tuple[tuple[Point | None, Point | None], ...] = (
    (None, (0.62, 0.70)),
    (None, (0.60, 0.42)),
    ((0.38, 0.70), None),
    ((0.40, 0.42), None),
    ((0.43, 0.66), (0.57, 0.66)),
    ((0.22, 0.52), (0.78, 0.52)),
)
SLOTS: tuple[Point, ...] = ((0.2, 0.3), (0.5, 0.25), (0.8, 0.3), (0.25, 0.58), (0.52, 0.55), (0.78, 0.58))


@dataclass(frozen=True, slots=True)
class Truth:
    """What is really going on at one moment; verbs are class indices.

    `current` is the action under way (None between actions), `following` the next to begin, at `onset_ns`;
    `intended` is the verb that body and eyes are busy with: the one in preparation, else the one under way, else None.
    """

    current: int | None
    following: int
    onset_ns: int
    intended: int | None

    def is_right(self, verb_index: int) -> bool:
        """True when assisting `verb_index` now is what the person wants: preparing it or in the middle of it."""
        return is_right(verb_index, self.current, self.intended)


@dataclass(frozen=True, slots=True)
class ArmIntention:
    """Where the person wants the forearm: elbow angle in degrees from hanging, and its velocity in deg/s."""

    angle_deg: float
    velocity_deg_s: float


# A fixation lasts nine steps of 25 Hz and a blink four: making their random generators anew each time would take a tenth
# of all recording.
@lru_cache(maxsize=64)
def _fixation(seed: int, number: int) -> tuple[float, int, int]:
    """How attentive (0..1) the eyes are in this fixation, and the slot they wander to when not, or when idle."""
    rng, idle = (np.random.default_rng([seed, 4, number]) for _ in range(2))
    return float(rng.uniform()), int(rng.integers(len(SLOTS))), int(idle.integers(len(SLOTS)))


@lru_cache(maxsize=64)
def _blinks(seed: int, number: int) -> bool:
    return bool(np.random.default_rng([seed, 5, number]).uniform() < 0.03)


@dataclass(frozen=True, slots=True)
class _Segment:
    """From `from_ns` on, body and eyes are busy with `event` (None: idle)."""

    from_ns: int
    event: Event | None


class Wearer:
    """One simulated person.

    seed: the person and the session. difficulty: how clear the preparations are. tremor: added to hands and arm.
    width_px, height_px: size of the rendered pictures (72 rows are enough for the features and fastest).
    """

    def __init__(
        self,
        seed: int,
        *,
        difficulty: Difficulty = DEMO,
        tremor: Tremor | None = None,
        width_px: int = 320,
        height_px: int = 240,
    ) -> None:
        self._seed = seed
        self._shaking = Shaking(tremor, seed)
        self._size = (width_px, height_px)
        self._timeline = Timeline(seed, difficulty)
        self._gaze_noise, self._hand_noise = Noise(seed, 3), Noise(seed, 6)
        self._segments: list[_Segment] = [_Segment(0, None)]
        self._starts: list[int] = [0]
        self._planned = 0
        self._planned_ns = -1
        self._last_palms: tuple[int | None, tuple[Point, Point]] = (None, REST)
        rng = np.random.default_rng([seed, 2])
        self._places = [SLOTS[slot] for slot in rng.permutation(COLOURS)]  # of each object, by colour
        # Plain floats: numpy's scalars are slow one at a time.
        self._phases: list[float] = rng.uniform(0.0, 2.0 * math.pi, size=12).tolist()
        self._hand_bias: list[list[float]] = rng.normal(0.0, 0.02, size=(2, 2)).tolist()
        self._gaze_bias: list[float] = rng.normal(0.0, 0.012, size=2).tolist()
        self._scene = Scene.of_person(rng)

    def truth(self, t_ns: int) -> Truth:
        """What the person is doing and about to do at `t_ns`."""
        events = self._timeline.until(t_ns)
        position = bisect_right(events, t_ns, key=lambda event: event.start_ns)
        current = events[position - 1] if position and t_ns < events[position - 1].end_ns else None
        busy = self._segment(t_ns).event
        return Truth(
            None if current is None else current.verb,
            events[position].verb,
            events[position].start_ns,
            None if busy is None else busy.verb,
        )

    def events(self, until_ns: int) -> list[Event]:
        """All actions that start before `until_ns`."""
        return [event for event in self._timeline.until(until_ns) if event.start_ns < until_ns]

    def busy_with(self, t_ns: int) -> Event | None:
        """The action that body and eyes are busy with (for judging, never for predicting)."""
        return self._segment(t_ns).event

    def gaze(self, t_ns: int) -> GazeSample:
        """Point of regard: rests on the object in use, wanders when idle, jumps between fixations, blinks at times."""
        noise = self._gaze_noise.normals(t_ns, 1)
        attention, after_it, elsewhere = _fixation(self._seed, t_ns // (380 * MS))
        segment = self._segment(t_ns)
        # The eyes lead: they are on the object 200 ms after the intention forms, and glance away now and then.
        busy = segment.event is not None and t_ns - segment.from_ns > 200 * MS
        if busy and segment.event is not None and attention < 0.8:
            x, y = self._object(segment.event)
        else:
            x, y = SLOTS[after_it if busy else elsewhere]
        sway = self._sway(t_ns)
        x, y = (at + jerk for at, jerk in zip((x, y), self._shaking.gaze(t_ns), strict=True))
        blink = _blinks(self._seed, t_ns // (160 * MS))
        return GazeSample(
            t_ns,
            x + sway[0] + self._gaze_bias[0] + noise[0] * 0.006,
            y + sway[1] + self._gaze_bias[1] + noise[1] * 0.008,
            not blink,
            StampSource.HARDWARE,
        )

    def hands(self, t_ns: int) -> HandTracks:
        """Both palms as a detector would give them; one is missed now and then."""
        *missed, left_x, left_y, right_x, right_y = self._hand_noise.normals(t_ns, 3)
        jitter = ((left_x, left_y), (right_x, right_y))
        found = [
            Hand(x + 0.005 * dx, y + 0.005 * dy, 0.9)
            for side, ((x, y), (dx, dy), miss) in enumerate(zip(self._palms(t_ns), jitter, missed, strict=True))
            if miss <= 2.3 and not self._shaking.loses(side, t_ns)
        ]
        return HandTracks(t_ns, tuple(found))

    def frame(self, t_ns: int) -> CameraFrame:
        """The head camera's picture, rendered."""
        segment = self._segment(t_ns)
        share_new = self._blend(t_ns, segment)
        scale = [1.0] * COLOURS
        for busy, share in ((segment.event, share_new), (self._previous(t_ns), 1.0 - share_new)):
            if busy is not None:
                # Leaning in makes the object in use larger: so the picture tells its colour even without gaze.
                scale[busy.cell[0]] += share * (0.35 + 1.0 * busy.strength)
        picture = draw(self._size, self._places, scale, self._palms(t_ns), self._sway(t_ns))
        return CameraFrame(t_ns, picture, t_ns // (40 * MS), StampSource.HARDWARE, self._scene.palette)

    def arm_intention(self, t_ns: int) -> ArmIntention:
        """Elbow angle the person aims for: raised while reaching or working, lowered at rest, plus any tremor."""
        step_ns = 2 * MS
        before, after = self._elbow(t_ns - step_ns), self._elbow(t_ns + step_ns)
        return ArmIntention(self._elbow(t_ns), (after - before) / (2 * step_ns * 1e-9))

    def _elbow(self, t_ns: int) -> float:
        palm_y = min(y for _, y in self._voluntary_palms(t_ns))
        angle = 30.0 + 120.0 * (0.95 - palm_y)
        return angle + self._shaking.arm_deg(t_ns)

    def _palms(self, t_ns: int) -> tuple[Point, Point]:
        # The picture and what is detected in it ask for the same moment.
        if t_ns != self._last_palms[0]:
            self._last_palms = (t_ns, self._palms_at(t_ns))
        return self._last_palms[1]

    def _palms_at(self, t_ns: int) -> tuple[Point, Point]:
        (ax, ay), (bx, by) = self._voluntary_palms(t_ns)
        (left_x, left_y), (right_x, right_y) = self._shaking.hands(t_ns)
        return (ax + left_x, ay + left_y), (bx + right_x, by + right_y)

    def _voluntary_palms(self, t_ns: int) -> tuple[Point, Point]:
        segment = self._segment(t_ns)
        share = self._blend(t_ns, segment) + self._shaking.overshoot(t_ns - segment.from_ns)
        old, new = self._targets(self._previous(t_ns)), self._targets(segment.event)
        drift = self._sway(t_ns)
        palms = []
        for side in range(2):
            wobble = 0.008 * math.sin(2.0 * math.pi * 0.9 * t_ns * 1e-9 + self._phases[8 + side])
            x = old[side][0] + (new[side][0] - old[side][0]) * share + self._hand_bias[side][0] + drift[0] + wobble
            y = old[side][1] + (new[side][1] - old[side][1]) * share + self._hand_bias[side][1] + drift[1]
            palms.append((x, y))
        return palms[0], palms[1]

    def _targets(self, event: Event | None) -> tuple[Point, Point]:
        """Where both hands end up while busy with `event`: the clearer the intention, the further they reach."""
        if event is None:
            return REST
        goal = self._object(event)
        extent = 0.4 + 0.6 * event.strength
        hands = []
        for rest, reach in zip(REST, REACH[event.cell[1]], strict=True):
            if reach is None:
                hands.append(rest)
                continue
            aim = (reach[0] + 0.15 * (goal[0] - reach[0]), reach[1] + 0.15 * (goal[1] - reach[1]))
            hands.append((rest[0] + extent * (aim[0] - rest[0]), rest[1] + extent * (aim[1] - rest[1])))
        return hands[0], hands[1]

    def _object(self, event: Event) -> Point:
        return self._places[event.cell[0]]

    def _sway(self, t_ns: int) -> Point:
        """Slow head movement, in picture widths: two sines of this person's own phases per axis."""
        t_s = t_ns * 1e-9
        p = self._phases
        x = 0.010 * math.sin(0.9 * t_s + p[0]) + 0.006 * math.sin(2.3 * t_s + p[1])
        y = 0.008 * math.sin(0.7 * t_s + p[2]) + 0.005 * math.sin(1.9 * t_s + p[3])
        head_x, head_y = self._shaking.head(t_ns)
        return x + head_x, y + head_y

    def _blend(self, t_ns: int, segment: _Segment) -> float:
        """How far the body has moved on to this segment: minimum-jerk from 0 to 1 within 0.6 s."""
        s = min(1.0, max(0.0, (t_ns - segment.from_ns) / BLEND_NS))
        return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)

    def _segment(self, t_ns: int) -> _Segment:
        self._plan(t_ns)
        return self._segments[max(0, bisect_right(self._starts, t_ns) - 1)]

    def _previous(self, t_ns: int) -> Event | None:
        self._plan(t_ns)
        return self._segments[max(0, bisect_right(self._starts, t_ns) - 2)].event

    def _plan(self, t_ns: int) -> None:
        """Segments up to `t_ns`: busy from preparation to the end, or to the next preparation; idle if that is long."""
        if t_ns <= self._planned_ns:
            return
        self._planned_ns = t_ns + 1_000 * MS  # ahead, so that it is not asked for at every step
        events = self._timeline.until(self._planned_ns + 4_000 * MS)
        while self._planned < len(events) - 1:
            event, after = events[self._planned], events[self._planned + 1]
            self._append(_Segment(event.prepare_ns, event))
            if after.prepare_ns - event.end_ns > BLEND_NS + 100 * MS:
                self._append(_Segment(event.end_ns, None))
            self._planned += 1

    def _append(self, segment: _Segment) -> None:
        self._segments.append(segment)
        self._starts.append(segment.from_ns)
