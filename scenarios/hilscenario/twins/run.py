"""The same seed twice with one event changed: what that event alone did to hand, energy and torque.

Person, tremor and plan are functions of the seed, so that the two runs are equal up to the event and differ afterwards by
what it did. The real controller runs, on the worn arm; it is put into ASSIST by hand, as an authorised ACT would.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import hypot
from pathlib import Path

from firmware_sim.plant.band import speed_power
from firmware_sim.plant.drive import Drive
from firmware_sim.plant.nerves import CONTROLS, Person, Tremor
from firmware_sim.plant.parameters import PRESETS
from firmware_sim.plant.tremors import KINDS, Recorded, Shaking
from firmware_sim.states import Reason, State
from firmware_sim.worn_device import WornDevice
from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.verbs import NEVER_ASSISTED, VERBS
from hilbridge.wearer.timeline import Event
from hilscenario.twins.reaching import first_of, reaches
from hilscenario.twins.recorded import torque_of

BEFORE_NS = 1_000 * MS
LONGEST_MS = 4_000  # of an action
AFTER_MS = 1_500
SILENCE_MS = 100  # until the command watchdog trips
STEP_S = 0.001


@dataclass(frozen=True)
class Body:
    """Who wears what."""

    control: str = "steady"
    tremor: str = "none"
    preset: str = "quasi-direct"
    cuff_nm_rad: float | None = None
    recorded_nm: tuple[float, ...] = ()  # a recorded tremor, in place of one by kind


@dataclass(frozen=True)
class Ask:
    """An ACT for `verb` from `from_ms` to `to_ms`; `lost`: it ends because nothing more is heard."""

    verb: str
    from_ms: int
    to_ms: int
    lost: bool = False


@dataclass(frozen=True)
class Pair:
    """One case: what is asked in the run, and in its twin. None: nothing."""

    event: str
    verb: str
    seed: int
    body: Body
    run: Ask | None
    twin: Ask | None
    action: Event


@dataclass(frozen=True)
class Trace:
    """One run, a value a millisecond."""

    hand: list[tuple[float, float]]
    elbow: list[float]
    speed: list[float]
    added_nm: list[float]  # assist and gravity support, behind the drive
    drive_nm: list[float]
    latched: bool


@dataclass(frozen=True)
class Difference:
    """What the changed event did. `work_j`: what the added torque gave to the arm, whatever it took back elsewhere.

    The rest is against the twin. `tremor` is the power of the elbow's speed from 3 to 12 Hz over the twin's; 1: as there.
    """

    work_j: float
    hand_mm: float
    drop_mm: float
    torque_nm: float
    tremor: float
    latched: int  # of the two runs


def body_of(control: str, tremor: str, preset: str, cuff_nm_rad: float | None) -> Body:
    """From what a person typed; `tremor` is a kind or a file. Raises InputError."""
    _one_of("--control", control, CONTROLS)
    _one_of("--preset", preset, PRESETS)
    if tremor in ("none", *KINDS):
        return Body(control, tremor, preset, cuff_nm_rad)
    if not Path(tremor).is_file():
        raise InputError(f"--tremor {tremor}: no such file, and no kind of tremor: there are none, {', '.join(KINDS)}")
    return Body(control, "recorded", preset, cuff_nm_rad, torque_of(Path(tremor)))


def verbs_of(names: Iterable[str]) -> tuple[str, ...]:
    """Verbs that the device assists. Raises InputError."""
    assisted = [verb for index, verb in enumerate(VERBS) if index not in NEVER_ASSISTED]
    for name in names:
        _one_of("--verb", name, assisted)
    return tuple(names)


def _one_of(option: str, name: str, known: Iterable[str]) -> None:
    if name not in known:
        raise InputError(f"{option} {name}: there are {', '.join(known)}")


def length_ms(action: Event) -> int:
    """How long a case runs."""
    reach_ms = (action.start_ns - action.prepare_ns) // MS
    return BEFORE_NS // MS + reach_ms + acted_ms(action) + AFTER_MS


def acted_ms(action: Event) -> int:
    """The action, or as much of it as is looked at."""
    return min(LONGEST_MS, (action.end_ns - action.start_ns) // MS)


def begins_ms(action: Event) -> int:
    """The onset of the action, from the start of the run."""
    return (action.start_ns - action.prepare_ns + BEFORE_NS) // MS


def trace(seed: int, body: Body, action: Event, ask: Ask | None) -> Trace:
    """One run."""
    shortened = replace(action, end_ns=action.start_ns + acted_ms(action) * MS)
    plan = reaches([shortened], action.prepare_ns - BEFORE_NS)
    device = WornDevice(
        Person(plan, CONTROLS[body.control], _tremor(body, seed)), PRESETS[body.preset], body.cuff_nm_rad
    )
    arm, law, added = device.arm, device.state.torque, Drive(PRESETS[body.preset])
    made = Trace([], [], [], [], [], latched=False)
    latched = False
    for now_ms in range(length_ms(action)):
        if ask is not None:
            _tell(device, ask, now_ms)
        device.tick()
        latched = latched or device.state.state is State.LATCHED
        made.hand.append(arm.hand())
        made.elbow.append(arm.angle[1])
        made.speed.append(arm.device_speed[1])
        made.added_nm.append(added.step((law.assist_unm + law.gravity_unm) * 1e-6, STEP_S))
        made.drive_nm.append(device.drive.torque_nm)
    return replace(made, latched=latched)


def difference(run: Trace, twin: Trace) -> Difference:
    """What differs."""
    work = sum(max(0.0, torque * speed) * STEP_S for torque, speed in zip(run.added_nm, run.speed, strict=True))
    moved = [(x - a, y - b) for (x, y), (a, b) in zip(run.hand, twin.hand, strict=True)]
    return Difference(
        work,
        1e3 * max(hypot(*one) for one in moved),
        1e3 * max(0.0, *(-up for _, up in moved)),
        max(abs(here - there) for here, there in zip(run.drive_nm, twin.drive_nm, strict=True)),
        speed_power(run.elbow) / speed_power(twin.elbow),
        run.latched + twin.latched,
    )


def cases(seed: int, body: Body, verbs: tuple[str, ...]) -> list[Pair]:
    """The changed events for one person: each verb of `verbs` that the person ever does."""
    made = []
    for verb in verbs:
        if (action := first_of(seed, verb)) is None:
            continue
        start, end = begins_ms(action), begins_ms(action) + acted_ms(action)
        right = Ask(verb, start, end)  # a verb's code is its index and one
        wrong = next(one for one in ("Pour", "Take", "Cut") if one != verb)
        early = max(600, start - 900)  # in the middle of the reach
        pairs = [
            ("false ACT", Ask(verb, early, end), None),
            ("wrong verb", Ask(wrong, start, end), right),
            ("missed assist", None, right),
        ]
        if verb == "Pour":
            half = (start + end) // 2 + SILENCE_MS
            pairs.append(("dropout mid-pour", Ask(verb, start, half, lost=True), right))
        made += [Pair(event, verb, seed, body, run, twin, action) for event, run, twin in pairs]
    return made


def compare(pair: Pair) -> tuple[Difference, Trace, Trace]:
    """Run both."""
    run, twin = (trace(pair.seed, pair.body, pair.action, ask) for ask in (pair.run, pair.twin))
    return difference(run, twin), run, twin


def _tremor(body: Body, seed: int) -> Tremor | None:
    if body.recorded_nm:
        return Recorded(body.recorded_nm)
    return None if body.tremor == "none" else Shaking(KINDS[body.tremor], seed)


def _tell(device: WornDevice, ask: Ask, now_ms: int) -> None:
    state = device.state
    if now_ms == ask.from_ms and state.state is State.FOLLOW:
        state.state, state.verb, state.assist_since_ms = State.ASSIST, VERBS.index(ask.verb) + 1, state.last_tick_ms
    elif now_ms == ask.to_ms and state.state is State.ASSIST:
        state.state, state.ramp_fault = State.RAMP_DOWN, ask.lost
        state.reason = Reason.COMMAND_TIMEOUT if ask.lost else Reason.HOLD
