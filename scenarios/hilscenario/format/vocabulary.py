"""The one vocabulary of faults: names, what each does, and its options. Engine, live mode and campaigns all use it.

A name is `target.kind`. A fault's options are numbers with their unit in the name; what is left out has the default.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field

SENSORS = ("camera", "gaze", "hands")


@dataclass(frozen=True, slots=True)
class Option:
    """A number, its default and its inclusive limits."""

    default: float
    low: float
    high: float
    about: str


@dataclass(frozen=True, slots=True)
class FaultKind:
    """One fault: what it does, its options, and whether it takes effect at an instant (so that `for` means nothing)."""

    name: str
    about: str
    options: Mapping[str, Option] = field(default_factory=dict)
    instant: bool = False


_SENSOR_KINDS: dict[str, tuple[str, dict[str, Option]]] = {
    "off": ("delivers nothing", {}),
    "stuck": ("delivers its last content again and again, with fresh stamps", {}),
    "garbage": ("delivers what no sensor could see: NaN, huge numbers, noise", {}),
    "wrong": (
        "delivers another moment's content, plausible and false",
        {"shift_s": Option(20.0, 1.0, 300.0, "how far")},
    ),
    "slow": ("delivers one value in `keep_every`", {"keep_every": Option(4, 2, 100, "one value of so many")}),
    "delayed": ("delivers late, with true stamps", {"delay_ms": Option(120, 1, 5000, "by so much")}),
    "intermittent": (
        "loses values at random",
        {"loss": Option(0.5, 0.01, 1.0, "share that is lost")},
    ),
    "drift": ("wanders off", {"per_s": Option(0.05, 0.001, 10.0, "picture widths a second; a camera darkens")}),
    "clock_skew": ("stamps with a clock that is off", {"skew_ms": Option(200, -5000, 5000, "added to stamps")}),
}

_WHICH = {"can_id": Option(-1, -1, 0x7FF, "only frames of this CAN identifier; -1: all frames")}
_SHARE = {"share": Option(1.0, 0.001, 1.0, "share of these frames")}

_OTHERS: tuple[FaultKind, ...] = (
    FaultKind("bus.drop", "frames vanish on their way", {**_WHICH, **_SHARE}),
    FaultKind("bus.delay", "frames come late", {**_WHICH, "delay_ms": Option(30, 0.1, 10_000, "by so much")}),
    FaultKind("bus.duplicate", "frames come twice", {**_WHICH, **_SHARE}),
    FaultKind(
        "bus.corrupt",
        "bits of the payload flip behind the CAN CRC",
        {**_WHICH, **_SHARE, "bits": Option(2, 1, 64, "how many")},
    ),
    FaultKind("bus.reorder", "frames change places with the one behind", {**_WHICH, **_SHARE}),
    FaultKind(
        "bus.babble",
        "a node floods the bus",
        {
            "can_id": Option(0x000, 0, 0x7FF, "with this identifier"),
            "per_s": Option(6000, 1, 20_000, "frames a second"),
        },
    ),
    FaultKind("bus.cut", "the wire is cut: nobody hears anybody"),
    FaultKind("bus.bus_off", "the bridge's controller goes bus-off", instant=True),
    FaultKind(
        "bus.stale_queue",
        "the bridge's frames wait in a queue and come out together at the end",
        {"frames": Option(512, 1, 512, "what the queue holds")},
    ),
    FaultKind(
        "bus.replay",
        "recorded frames of the bridge are sent again",
        {"past_s": Option(2.0, 0.05, 60.0, "recorded so long before")},
    ),
    FaultKind(
        "bus.forge",
        "made-up ACT_CMD and ACT_AUTH with right CRC and counter",
        {"per_s": Option(25, 1, 1000, "pairs a second")},
    ),
    FaultKind("bus.stop", "somebody puts STOP on the bus, three times at 10 ms", instant=True),
    FaultKind("bridge.hang", "the process stands still (SIGSTOP)"),
    FaultKind("bridge.stall", "the event loop is blocked, as by a long garbage collection"),
    FaultKind("bridge.kill", "the process is killed", instant=True),
    FaultKind(
        "bridge.restart",
        "the process is killed and started again",
        {"down_ms": Option(500, 10, 60_000, "dead for so long")},
        instant=True,
    ),
    FaultKind(
        "bridge.second",
        "another bridge speaks on the same bus, with counters of its own",
        {"per_s": Option(25, 1, 1000, "commands a second")},
    ),
    FaultKind("device.restart", "the device loses power and starts anew, with nothing remembered", instant=True),
    FaultKind("device.wrong_key", "the device has started anew with another key; at the end with the right one again"),
    FaultKind(
        "device.sensor_fault",
        "the device's joint sensor jumps and sticks",
        {"offset_deg": Option(25, 1, 180, "by so much")},
    ),
    FaultKind(
        "device.actuator_lag", "torque follows late", {"time_constant_ms": Option(60, 1, 1000, "first-order lag")}
    ),
    FaultKind(
        "device.torque_bias",
        "the actuator adds torque nobody asked for",
        {"bias_nm": Option(0.5, -5.0, 5.0, "so much")},
    ),
    FaultKind(
        "device.tick_overrun",
        "the control tick takes too long",
        {"overrun_ms": Option(8, 1, 1000, "of the device's own time")},
        instant=True,
    ),
    FaultKind(
        "wearer.tremor",
        "hands and arm shake",
        {
            "hz": Option(6, 1, 15, "frequency"),
            "amplitude": Option(0.02, 0.001, 0.3, "picture widths"),
            "arm_deg": Option(3, 0, 30, "at the elbow"),
        },
    ),
    FaultKind(
        "wearer.ataxia", "reaches overshoot and wander", {"amplitude": Option(0.05, 0.001, 0.3, "picture widths")}
    ),
    FaultKind(
        "wearer.opposing", "the wearer pushes against the assist", {"torque_nm": Option(2.0, 0.1, 10.0, "with so much")}
    ),
    FaultKind("wearer.blink", "the eyes are shut"),
    FaultKind("wearer.look_away", "the eyes leave the picture"),
    FaultKind("wearer.hands_out_of_view", "no hand is seen"),
)

FAULTS: dict[str, FaultKind] = {
    **{
        f"{sensor}.{kind}": FaultKind(f"{sensor}.{kind}", f"{sensor}: {about}", options)
        for sensor in SENSORS
        for kind, (about, options) in _SENSOR_KINDS.items()
    },
    **{kind.name: kind for kind in _OTHERS},
}

# Who carries a fault of the bus out: its wire, or a third node on it. All others are a tap's, between node and bus.
WIRE_FAULTS = ("bus.cut", "bus.bus_off")
INTRUDER_FAULTS = ("bus.babble", "bus.replay", "bus.forge", "bus.stop", "bridge.second")


def fault_kind(name: str) -> FaultKind:
    """The fault of that name. Raises ValueError offering the nearest name."""
    if name in FAULTS:
        return FAULTS[name]
    near = difflib.get_close_matches(name, FAULTS, n=1, cutoff=0.4)
    hint = f"did you mean `{near[0]}`?" if near else "`hilscenario faults` lists them"
    raise ValueError(f"unknown fault `{name}`; {hint}")


def checked_options(name: str, given: Mapping[str, float]) -> dict[str, float]:
    """All options of a fault, with defaults. Raises ValueError naming the option, its value and its limits."""
    kind = fault_kind(name)
    for option, value in given.items():
        if option not in kind.options:
            near = difflib.get_close_matches(option, kind.options, n=1)
            known = ", ".join(kind.options) or "none"
            hint = f"did you mean `{near[0]}`?" if near else f"it has: {known}"
            raise ValueError(f"fault `{name}` has no option `{option}`; {hint}")
        limits = kind.options[option]
        if not limits.low <= value <= limits.high:
            raise ValueError(f"`{option}` = {value:g} of fault `{name}`: must be {limits.low:g} to {limits.high:g}")
    return {option: float(given.get(option, kind.options[option].default)) for option in kind.options}
