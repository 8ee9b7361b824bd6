"""Benefit on paper: a table of help and harm by device, what differs between devices, and a picture. Intervals by person."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import degrees
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.files import in_place_of, write_whole
from hilbridge.observe.report import plotter
from hilscenario.benefit.measured import PEAKS, SUMS, added
from hilscenario.benefit.run import ALWAYS, CALIBRATED, OFF, UNCALIBRATED, Outcome

Array = NDArray[np.float64]
_DRAWS, _LEVEL = 2_000, 95.0
_AT = {name: number for number, name in enumerate(SUMS)}


@dataclass(frozen=True)
class Figure:
    """One figure: `top` over `bottom` of the sums, its root where it is a mean square, times `scale`."""

    title: str
    top: str
    bottom: str
    scale: float = 1.0
    is_square: bool = False
    digits: int = 2

    def of(self, sums: Array) -> Array:
        """From sums in the order of SUMS, along the last axis; NaN where there is nothing to divide by."""
        top, bottom = sums[..., _AT[self.top]], sums[..., _AT[self.bottom]]
        ratio: Array = np.divide(top, bottom, out=np.full(np.shape(top), np.nan), where=bottom > 0.0)
        return np.asarray(self.scale * (np.sqrt(ratio) if self.is_square else ratio), float)


ON_TARGET = Figure("on target %", "on_target_s", "acting_s", 100.0, digits=1)
PATH = (
    ON_TARGET,
    Figure("off path mm", "error_m2s", "acting_s", 1e3, is_square=True),
    Figure("tremor mm", "tremor_m2s", "acting_s", 1e3, is_square=True),
)
SPILL = (
    Figure("shaken m/s2", "shaken_m2_s3", "carrying_s", is_square=True),
    Figure("tilt deg", "tilted_rad2s", "carrying_s", degrees(1.0), is_square=True),
)
GATE = (
    Figure("coverage", "act_ticks", "ticks"),
    Figure("precision", "right_ticks", "judged_ticks"),
    Figure("false /min", "false_assists", "seconds", 60.0),
)
HARM = (
    Figure("wrong mJ/min", "wrong_j", "seconds", 60e3),
    Figure("moved mm", "moved_meter_s", "seconds", 1e3),
)
HELP = (*PATH, *SPILL)
FIGURES = (*HELP, *GATE, *HARM)
TABLES = {"path": PATH, "spilling": SPILL, "gate": GATE, "harm": HARM}


@dataclass(frozen=True)
class Estimate:
    """A figure with its interval."""

    value: float
    low: float
    high: float

    def told(self, digits: int, sign: str = "") -> str:
        """As a cell of a table."""
        if np.isnan(self.value):
            return "-"
        return f"{self.value:{sign}.{digits}f} ({self.low:{sign}.{digits}f} to {self.high:{sign}.{digits}f})"


class Sample:
    """The sums of every device by person, and the same people drawn again with replacement for every figure."""

    def __init__(self, outcomes: Sequence[Outcome]) -> None:
        self.devices = list(dict.fromkeys(one.device for one in outcomes))
        people = sorted({one.visit.person for one in outcomes})
        self.people, self.sessions = len(people), len({one.visit for one in outcomes})
        self._sums = {device: np.zeros((len(people), len(SUMS))) for device in self.devices}
        for one in outcomes:
            self._sums[one.device][people.index(one.visit.person)] += [one.sums[name] for name in SUMS]
        self.worst = {device: added([one.sums for one in outcomes if one.device == device]) for device in self.devices}
        self._drawn = np.random.default_rng(0).multinomial(self.people, [1.0 / self.people] * self.people, _DRAWS)

    def estimate(self, statistic: Callable[[dict[str, Array]], Array]) -> Estimate:
        """A statistic of all devices' sums, with its percentile interval by person."""
        whole = float(statistic({name: sums.sum(axis=0) for name, sums in self._sums.items()}))
        drawn = statistic({name: self._drawn @ sums for name, sums in self._sums.items()})
        tail = (100.0 - _LEVEL) / 2.0
        low, high = (np.nan, np.nan) if np.isnan(drawn).all() else np.nanpercentile(drawn, [tail, 100.0 - tail])
        return Estimate(whole, float(low), float(high))

    def figure(self, device: str, figure: Figure) -> Estimate:
        """One figure of one device."""
        return self.estimate(lambda sums: figure.of(sums[device]))

    def apart(self, device: str, other: str, figure: Figure) -> Estimate:
        """How much larger it is than with another device, on the same sessions."""
        return self.estimate(lambda sums: figure.of(sums[device]) - figure.of(sums[other]))

    def at_equal_help(self, helps: Figure, figure: Figure) -> Estimate:
        """`figure` of the calibrated gate less that of an uncalibrated one that is equal in `helps`.

        Between thresholds, and from the device that is off, straight lines; NaN where no uncalibrated gate helps as much.
        """
        curve = [name for name in self.devices if name == OFF or name.startswith(UNCALIBRATED)]

        def statistic(sums: dict[str, Array]) -> Array:
            x = np.stack([helps.of(sums[name]) for name in curve], axis=-1)
            y = np.stack([figure.of(sums[name]) for name in curve], axis=-1)
            return figure.of(sums[CALIBRATED]) - _between(x, y, helps.of(sums[CALIBRATED]))

        return self.estimate(statistic)


def _between(x: Array, y: Array, wanted: Array) -> Array:
    """`y` where `x` is as wanted, row by row."""
    order = np.argsort(x, axis=-1)
    x, y = np.take_along_axis(x, order, -1), np.take_along_axis(y, order, -1)
    rows = zip(np.atleast_1d(wanted), np.atleast_2d(x), np.atleast_2d(y), strict=True)
    found = [float(np.interp(own, helps, harms, left=np.nan, right=np.nan)) for own, helps, harms in rows]
    return np.reshape(np.asarray(found), np.shape(wanted))


def table(sample: Sample, figures: Sequence[Figure]) -> list[tuple[str, ...]]:
    """A line a device."""
    return [
        (device, *(sample.figure(device, figure).told(figure.digits) for figure in figures))
        for device in sample.devices
    ]


def peaks(sample: Sample) -> list[tuple[str, ...]]:
    """The worst of every device, which has no interval."""
    return [
        (device, *(f"{1e3 * worst[name]:.1f}" for name in PEAKS), f"{worst['latched']:.0f}")
        for device, worst in sample.worst.items()
    ]


_EQUALLED = (GATE[2], *HARM)
EQUAL_TITLES = (f"calibrated less {UNCALIBRATED}", *(one.title for one in _EQUALLED))
PEAK_TITLES = ("worst", "mJ of one wrong ACT", "hand moved mm", "latched")


def differences(sample: Sample, figures: Sequence[Figure]) -> list[tuple[str, ...]]:
    """The calibrated gate less every other device."""
    return [
        (f"less {other}", *(sample.apart(CALIBRATED, other, figure).told(figure.digits, "+") for figure in figures))
        for other in sample.devices
        if other != CALIBRATED
    ]


def at_equal_help(sample: Sample) -> list[tuple[str, ...]]:
    """The calibrated gate less an uncalibrated one that helps as much, by each measure of help."""
    return [
        (f"equal {helps.title}", *(sample.at_equal_help(helps, one).told(one.digits, "+") for one in _EQUALLED))
        for helps in HELP
    ]


def as_json(outcomes: Sequence[Outcome]) -> str:
    """Every session's sums, and every figure of all and of each kind of tremor."""
    groups = {"all": list(outcomes)}
    for one in outcomes:
        groups.setdefault(one.visit.kind, []).append(one)
    return json.dumps(
        {
            "figures": {kind: _figures(Sample(of)) for kind, of in groups.items()},
            "sessions": [
                {"device": one.device, "person": one.visit.person, "seed": one.visit.seed, "kind": one.visit.kind, **one.sums}
                for one in outcomes
            ],
        },
        indent=1,
    )  # fmt: skip


def _figures(sample: Sample) -> dict[str, object]:
    def told(estimate: Estimate) -> list[float | None]:
        return [None if np.isnan(one) else one for one in (estimate.value, estimate.low, estimate.high)]

    others = [device for device in sample.devices if device != CALIBRATED]
    return {
        "people": sample.people,
        "sessions": sample.sessions,
        "devices": {
            device: {one.title: told(sample.figure(device, one)) for one in FIGURES}
            | {name: sample.worst[device][name] for name in (*PEAKS, "latched")}
            for device in sample.devices
        },
        f"{CALIBRATED} less": {
            other: {one.title: told(sample.apart(CALIBRATED, other, one)) for one in FIGURES} for other in others
        },
        "at equal": {
            helps.title: {one.title: told(sample.at_equal_help(helps, one)) for one in _EQUALLED} for helps in HELP
        },
    }


def draw(sample: Sample, path: Path) -> None:
    """Help against harm: each device with both intervals, help as what it adds to the device that is off."""
    plt = plotter()
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    for axis, helps in zip(axes, (ON_TARGET, SPILL[0]), strict=True):
        for device in sample.devices:
            x, y = sample.apart(device, OFF, helps), sample.figure(device, HARM[0])
            colour = {OFF: "#6c757d", CALIBRATED: "#2a9d5c", ALWAYS: "#d1495b"}.get(device, "#457b9d")
            across = [[x.value - x.low], [x.high - x.value]]
            upwards = [[y.value - y.low], [y.high - y.value]]
            axis.errorbar(x.value, y.value, upwards, across, fmt="o", color=colour, lw=1.0, capsize=2.0)
            axis.annotate(device, (x.value, y.value), xytext=(5, 5), textcoords="offset points", fontsize=8)
        axis.set_xlabel(f"{helps.title}, more than with the device off")
        axis.set_ylabel(f"harm: {HARM[0].title}")
    figure.suptitle(f"{sample.sessions} sessions of {sample.people} people; 95 % by person", fontsize=9)
    with in_place_of(path) as partial:
        figure.savefig(partial, format="png", dpi=90)
    plt.close(figure)


def write(outcomes: Sequence[Outcome], out: Path) -> None:
    """`benefit.json` and `benefit.png` in the folder."""
    write_whole(out / "benefit.json", as_json(outcomes))
    draw(Sample(outcomes), out / "benefit.png")
