"""The frozen records that pass between rooms. Units stand at the end of names; every `_ns` is the monotonic clock.

A record says what happened, never what to do about it. Arrays inside records are not written to after construction.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class StampSource(StrEnum):
    """Where a capture stamp comes from, best first."""

    HARDWARE = "hardware"
    RTCP = "rtcp"
    ARRIVAL = "arrival"


class Modality(IntEnum):
    """What can go missing on its own; the value is the bit in validity masks (BRIDGE_HB, bundles)."""

    GAZE = 0
    HANDS = 1
    SCENE = 2


@dataclass(frozen=True, slots=True)
class CameraFrame:
    """One picture. `pixels` is (height, width, 3) RGB, or (height, width) indices into `palette`, which is (n, 3) RGB:
    pictures that are drawn have a few colours only. All of them uint8 and C-contiguous.
    """

    captured_ns: int
    pixels: NDArray[np.uint8]
    sequence: int
    stamp: StampSource = StampSource.ARRIVAL
    palette: NDArray[np.uint8] | None = None

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """(height, width, 3) uint8, C-contiguous; made anew at each call where there is a palette."""
        return self.pixels if self.palette is None else self.palette.take(self.pixels, axis=0)


@dataclass(frozen=True, slots=True)
class GazeSample:
    """A point of regard in the scene camera's picture: x, y in 0..1 from the top left; `valid` is False in a blink."""

    captured_ns: int
    x: float
    y: float
    valid: bool
    stamp: StampSource = StampSource.ARRIVAL


@dataclass(frozen=True, slots=True)
class Hand:
    """One detected hand: palm centre in 0..1 of the picture from the top left, detector score 0..1.

    `landmarks` has x, y, z of each point one after the other where the detector gives them; empty otherwise.
    """

    x: float
    y: float
    score: float
    landmarks: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class HandTracks:
    """All hands found in one picture, in no particular order; `captured_ns` is the picture's."""

    captured_ns: int
    hands: tuple[Hand, ...]


@dataclass(frozen=True, slots=True)
class BodySample:
    """Three numbers of one sensor on the body: its acceleration in m/s^2, gravity included, or a joint's place in metres."""

    captured_ns: int
    sensor: str
    x: float
    y: float
    z: float
    valid: bool = True
    stamp: StampSource = StampSource.ARRIVAL


@dataclass(frozen=True, slots=True)
class FeatureVector:
    """The input x_t of the network at one 25 Hz step, before z-scoring (features/layout.py names each entry).

    `values` is (D,) float32, finite; `valid` has one entry per Modality (u_t); entries of an invalid modality are 0.
    `oldest_input_ns` is the capture stamp of the oldest valid input used, `captured_ns` the moment that the step is of:
    live, the picture's capture stamp.
    """

    oldest_input_ns: int
    captured_ns: int
    values: NDArray[np.float32]
    valid: tuple[bool, bool, bool]


@dataclass(frozen=True, slots=True)
class IntentEstimate:
    """What the predictor believes the next verb is.

    `probabilities` has one entry per class of `verbs.VERBS`, scaled by the temperature, and sums to 1; `confidence` is that
    of `verb_index`, the top class. `valid` is the modality mask of the newest step. `condition` names the map that makes
    confidence of what the gate smooths (`hilbridge.confidence`); None: probabilities mean what they say, as a script's do.
    """

    oldest_input_ns: int
    produced_ns: int
    probabilities: tuple[float, ...]
    verb_index: int
    confidence: float
    bundle_id: int
    valid: tuple[bool, bool, bool]
    condition: int | None = None


class Action(IntEnum):
    """The gate's command, coded as on the wire (two bits, so that one flipped bit is never the other action)."""

    HOLD = 0b01
    ACT = 0b10


class HoldReason(StrEnum):
    """Why the bridge holds. Exactly one is named for every HOLD, the first that applies from the top.

    A cause stands above what follows from it: a bridge that cannot see makes the device follow, not the other way round.
    The five reasons of sensing are named for as long as ACT has to be earned anew after them (`limits.EARN_NS`).
    """

    NONE = "none"  # the decision is ACT
    STOPPED = "stopped"
    DEVICE_FAULT = "device_fault"
    OVERRUN = "overrun"
    SENSOR_MISSING = "sensor_missing"
    WARMING_UP = "warming_up"
    NO_ESTIMATE = "no_estimate"
    STALE = "stale"
    DEVICE_SILENT = "device_silent"
    LISTEN_ONLY = "listen_only"
    NOT_ARMED = "not_armed"
    DEVICE_NOT_READY = "device_not_ready"  # armed, but awaiting its three HOLDs or ramping down
    TREMOR = "tremor"
    DRIFT = "drift"  # confidence is not what it was for the bundle's people; until the bridge starts anew
    VERB_NOT_ASSISTED = "verb_not_assisted"
    REFRACTORY = "refractory"
    VERB_CHANGE = "verb_change"
    NOT_TOP_K = "not_top_k"
    CONFIDENCE = "confidence"


@dataclass(frozen=True, slots=True)
class GateDecision:
    """Act or Hold for one tick. `verb_index` is the assisted class under ACT and None under HOLD."""

    action: Action
    verb_index: int | None
    confidence: float
    reason: HoldReason


class Frame(NamedTuple):
    """One CAN frame as the rooms see it; both clocks are recorded where the port knows them.

    A tuple, because one is made for every frame on the bus: it costs a quarter of a frozen dataclass.
    """

    can_id: int
    data: bytes
    received_ns: int = 0
    wall_ns: int = 0
    is_error: bool = False
    is_fd: bool = False
    is_extended: bool = False
    hardware_ns: int = 0  # the adapter's own clock, where its driver gives it; 0 otherwise
    is_remote: bool = False
