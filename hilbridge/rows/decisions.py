"""Rows of what the bridge believes and decides."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

from hilbridge.records import HoldReason, IntentEstimate
from hilbridge.rows.fields import ActionByName
from hilbridge.verbs import DEFAULT, Vocabulary


@dataclass(frozen=True, slots=True)
class TickRow:
    """One 25 Hz tick: what was decided, on what, and why. With the features it has all that the decision stood on."""

    topic: ClassVar[str] = "/tick"

    time_ns: int
    action: ActionByName
    """The command as sent."""
    reason: HoldReason
    """Why the bridge holds; `none` under ACT."""
    confidence: float
    """What the gate compares with its thresholds, 0..1, to the last bit: smoothed, then calibrated."""
    verb: str | None = None
    """The assisted verb under ACT."""
    tau_on: float | None = None
    """The gate's thresholds, so that a plot shows confidence against them."""
    tau_off: float | None = None
    act: float | None = None
    """1 under ACT, 0 otherwise: what a plot can draw."""
    top_verb: str | None = None
    """The likeliest verb of the newest belief (/belief has all of them)."""
    top_confidence: float | None = None
    """Its probability, before smoothing."""
    gaze_valid: bool = False
    """Which modalities the newest features have."""
    hands_valid: bool = False
    scene_valid: bool = False
    sensing_age_ms: float | None = None
    """Age of the oldest input in the newest features."""
    sensor_problem: str | None = None
    """The first sensor that cannot be believed, and why."""
    new_features: bool = False
    """Whether this tick had features that no earlier tick had."""
    features_ns: int | None = None
    """`captured_ns` of those features (/features has them)."""
    first: bool = False
    """The bridge's first tick: it believes nothing yet."""
    outside: HoldReason = HoldReason.NONE
    """The bus's and the operator's reason to hold, as the gate was told."""
    overrun: bool = False
    """Whether the last tick was so long ago that this one decides for another moment."""
    tremor: bool = False
    """Whether the tremor guard holds by what it sees of the hands."""
    felt_tremor: bool | None = None
    """Whether it holds by what inertial sensors feel; absent where there are none."""
    felt_hz: float | None = None
    """The strongest line in the acceleration of the hands, whether it is a tremor or not."""
    felt_rms: float | None = None
    """Its root mean square, in m/s^2."""
    device_state: str | None = None
    """The device's state as last heard, in the DBC's words."""
    armed: bool = False
    """Whether a session with the device stands."""
    work_ms: float | None = None
    """From the start of the tick to its last frame handed to the port."""
    latency_ms: float | None = None
    """From the capture of the picture to its ACT_CMD handed to the port."""
    truth_known: bool = False
    """Whether the wearer's intention is known: simulated and labelled people."""
    truth: str | None = None
    """The verb that the wearer prepares or does; None while idle."""
    right: bool | None = None
    """Under ACT with known truth: whether the assisted verb is the wearer's."""

    @property
    def valid(self) -> tuple[bool, bool, bool]:
        """Gaze, hands, scene."""
        return self.gaze_valid, self.hands_valid, self.scene_valid


class GroundTruth(NamedTuple):
    """What the wearer really wants at one moment: the verb prepared or under way, and whether an assist of ours is it."""

    verb: str | None
    right: bool | None


def with_truth(row: TickRow, truth: GroundTruth | None) -> TickRow:
    """The tick judged; None where the wearer's intention is not known."""
    return row if truth is None else replace(row, truth_known=True, truth=truth.verb, right=truth.right)


@dataclass(frozen=True, slots=True)
class BeliefRow:
    """What the predictor made of new features: the whole of it, before the gate smooths it."""

    topic: ClassVar[str] = "/belief"

    time_ns: int
    oldest_input_ns: int
    produced_ns: int
    verb: str
    """The likeliest."""
    verb_index: int
    confidence: float
    """Its probability."""
    probabilities: tuple[float, ...]
    """Of every verb in the order of the bundle (/bundle names them)."""
    bundle_id: int
    gaze_valid: bool
    hands_valid: bool
    scene_valid: bool
    condition: int | None = None
    """Which map of the bundle makes confidence of it: modalities of the window in bits 0 to 2, level of tremor above."""


def belief_row(estimate: IntentEstimate, now_ns: int, vocabulary: Vocabulary = DEFAULT) -> BeliefRow:
    """A belief as it was, of a predictor with that vocabulary."""
    return BeliefRow(
        now_ns,
        estimate.oldest_input_ns,
        estimate.produced_ns,
        vocabulary.names[estimate.verb_index],
        estimate.verb_index,
        estimate.confidence,
        estimate.probabilities,
        estimate.bundle_id,
        *estimate.valid,
        estimate.condition,
    )


def estimate_of(row: BeliefRow) -> IntentEstimate:
    """The belief of a row, bit for bit."""
    valid = (row.gaze_valid, row.hands_valid, row.scene_valid)
    return IntentEstimate(
        row.oldest_input_ns,
        row.produced_ns,
        row.probabilities,
        row.verb_index,
        row.confidence,
        row.bundle_id,
        valid,
        row.condition,
    )
