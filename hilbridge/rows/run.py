"""Rows of the run itself: who recorded what with which settings, what was counted, what happened, what a person marked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar


@dataclass(frozen=True, slots=True)
class CountersRow:
    """Once a second, and at the end: every counter by name. `device.`, `wire.`, `port.`, `bridge.` name their owner."""

    topic: ClassVar[str] = "/counters"

    time_ns: int
    counts: dict[str, int]


@dataclass(frozen=True, slots=True)
class EventRow:
    """What a person would want to know: armed, link down, sensor gone, a fault injected."""

    topic: ClassVar[str] = "/event"

    time_ns: int
    text: str


@dataclass(frozen=True, slots=True)
class FaultRow:
    """A fault of a script begins or ends."""

    topic: ClassVar[str] = "/fault"

    time_ns: int
    fault: str
    target: str
    """What it befalls: the word before the fault's point."""
    begins: bool
    """False: it ends."""
    step: int
    """Its place in the script."""
    effects: int
    """How often it has taken effect so far."""
    options: dict[str, float]


@dataclass(frozen=True, slots=True)
class LabelRow:
    """What the wearer did or prepared from `time_ns` to `end_ns`, and who says so."""

    topic: ClassVar[str] = "/label"

    time_ns: int
    end_ns: int
    verb: str
    source: str


@dataclass(frozen=True, slots=True)
class MetaRow:
    """Once, first: who recorded what, with which configuration. Each part of a long recording begins with one."""

    topic: ClassVar[str] = "/meta"

    time_ns: int
    title: str | None = None
    bus: str | None = None
    physical: bool | None = None
    listen_only: bool | None = None
    bundle_id: str | None = None
    tau_on: float | None = None
    tau_off: float | None = None
    camera: str | None = None
    gaze: str | None = None
    participant: str | None = None
    """The wearer's pseudonym."""
    scenario: str | None = None
    seed: int | None = None
    start_ns: int | None = None
    """A live scenario's time 0 on the monotonic clock; its rows are relative to it."""
    wall_minus_monotonic_ns: int | None = None
    version: str | None = None
    """Of hilbridge."""
    revision: str | None = None
    """The commit of the sources, where they are a checkout."""
    part: int = 1
    """Which part of a recording in parts."""


@dataclass(frozen=True, slots=True)
class HostRow:
    """Once: the machine and its clocks. Virtual time has none."""

    topic: ClassVar[str] = "/host"

    time_ns: int
    name: str
    system: str
    python: str
    processors: int
    clock: str
    """What the monotonic clock is."""
    clock_resolution_ns: int
    wall: str
    """The wall clock at `time_ns`, ISO 8601 in UTC."""


@dataclass(frozen=True, slots=True)
class ConfigRow:
    """Once: every setting as it was resolved. Keys and their files are left out; that one was given is not."""

    topic: ClassVar[str] = "/config"

    time_ns: int
    settings: dict[str, Any]
    """Section -> key -> value; `gate_in_force` is what asking and bundle came to."""


@dataclass(frozen=True, slots=True)
class BundleRow:
    """Once: what predicted, and where it comes from."""

    topic: ClassVar[str] = "/bundle"

    time_ns: int
    bundle_id: int
    sha256: str
    """Of the file."""
    window_steps: int
    verbs: tuple[str, ...]
    tau_on: float
    tau_off: float
    intent: str = "predictor"
    """Where beliefs came from: `predictor` (this bundle), `script`, `recording`."""
    provenance: dict[str, Any] | None = None
    doubt: str | None = None
    """Why the provenance cannot be believed."""
