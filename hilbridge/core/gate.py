"""The Act/Hold gate: the one place that turns belief into a wish to assist (paper, "Safety-Oriented Gate" and E5).

HOLD is the default; ACT needs every condition below, in this order, and each HOLD names the first that fails:

1. no veto from outside (stopped, device fault, sensing not whole for long enough, not armed, ...);
2. a fresh estimate (age of its oldest input within `max_age_ns`);
3. the most likely verb of the smoothed belief is one the device assists at all;
4. that verb is among the `top_k` of the newest window (E5, filter ii);
5. its confidence, which is the smoothed probability as `maps` calibrates it, reaches `tau_on` - or, once acting, stays at
   `tau_off` or above;
6. the refractory time since the last switch is over.

The maps are fitted on exactly this: the candidate's smoothed probability at every tick of streams at which the gate
could act, against whether the candidate was right (`core.right`). So a threshold is a claim about what is compared with it.

Hysteresis and refractory delay switches that confidence drives, in both directions. Everything in 1 and 2 acts at once.
A change of verb is a switch to HOLD first; the new verb has to earn its own ACT after the refractory.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

from hilbridge.confidence import ConfidenceMaps
from hilbridge.limits import MS, REFRACTORY_MS, SENSING_LIMIT_NS
from hilbridge.records import Action, GateDecision, HoldReason, IntentEstimate
from hilbridge.verbs import DEFAULT, Vocabulary


@dataclass(frozen=True, slots=True)
class GateConfig:
    """Thresholds and times of the gate.

    tau_on, tau_off: calibrated confidence 0..1, tau_on > tau_off (hysteresis band).
    alpha: weight of the newest window in the moving average of class probabilities, 0 < alpha <= 1.
    top_k: the acting verb must be among so many of the newest window.
    refractory_ns: after any switch, confidence cannot switch again for so long.
    max_age_ns: oldest input an ACT may stand on (the contract: 150 ms).
    maps: from smoothed probability to confidence, of the bundle in use.
    vocabulary: the bundle's verbs, and which of them may be assisted on this bus.
    usual: between which bounds the mean confidence of the bundle's people lay, and under which condition; None where it does
    not say.

    Raises ValueError naming the field, its value and what is allowed.
    """

    tau_on: float
    tau_off: float
    alpha: float = 0.2
    top_k: int = 3
    refractory_ns: int = REFRACTORY_MS * MS
    max_age_ns: int = SENSING_LIMIT_NS
    maps: ConfidenceMaps = field(default_factory=ConfidenceMaps)
    vocabulary: Vocabulary = DEFAULT
    usual: tuple[float, float, int] | None = None

    def settings(self) -> dict[str, Any]:
        """Its numbers by name; maps, vocabulary and what is usual are the bundle's."""
        numbers = asdict(self)
        del numbers["maps"], numbers["vocabulary"], numbers["usual"]
        return numbers

    def __post_init__(self) -> None:
        if not 0.0 < self.tau_on <= 1.0:
            raise ValueError(f"tau_on = {self.tau_on}: must be above 0 and at most 1")
        if not 0.0 <= self.tau_off < self.tau_on:
            raise ValueError(f"tau_off = {self.tau_off}: must be at least 0 and below tau_on = {self.tau_on}")
        if not 0.0 < self.alpha <= 1.0:
            raise ValueError(f"alpha = {self.alpha}: must be above 0 and at most 1")
        if self.top_k < 1:
            raise ValueError(f"top_k = {self.top_k}: must be at least 1")
        if self.refractory_ns < 0:
            raise ValueError(f"refractory_ns = {self.refractory_ns}: must not be negative")
        if not 0 < self.max_age_ns <= SENSING_LIMIT_NS:
            raise ValueError(f"max_age_ns = {self.max_age_ns}: must be above 0 and at most 150 ms (safety contract)")


@dataclass(frozen=True, slots=True)
class GateState:
    """What the gate remembers between ticks. The default is how it starts: holding, believing nothing."""

    action: Action = Action.HOLD
    verb_index: int | None = None
    smoothed: tuple[float, ...] = ()
    switched_ns: int | None = None
    last_produced_ns: int | None = None


def step(
    config: GateConfig,
    state: GateState,
    estimate: IntentEstimate | None,
    now_ns: int,
    veto: HoldReason | None = None,
    *,
    blind: HoldReason | None = None,
) -> tuple[GateState, GateDecision]:
    """One 25 Hz tick. `veto` is the first outside reason to hold, or None when everything outside affirms.

    `blind` says why sensing has a gap now, whichever veto is named: what was smoothed before a gap says nothing about
    the time after it, so belief starts from nothing. An estimate that cannot be used is such a gap, too.
    The same estimate seen twice is smoothed once, so a stalled predictor cannot talk itself into confidence.
    """
    unusable = estimate_problem(config, estimate, now_ns)
    problem = veto or blind or unusable
    if blind is not None or unusable is not None or estimate is None:
        believed = replace(state, smoothed=(), last_produced_ns=None)
    elif estimate.produced_ns == state.last_produced_ns:
        believed = state
    else:
        smoothed = smooth(config.alpha, state.smoothed, estimate.probabilities)
        believed = replace(state, smoothed=smoothed, last_produced_ns=estimate.produced_ns)

    if problem is not None or estimate is None:
        return _hold(believed, now_ns, 0.0, problem or HoldReason.NO_ESTIMATE)
    return _decide(config, believed, estimate, now_ns)


def _decide(
    config: GateConfig, state: GateState, estimate: IntentEstimate, now_ns: int
) -> tuple[GateState, GateDecision]:
    candidate = max(range(len(state.smoothed)), key=state.smoothed.__getitem__)
    confidence = config.maps.confidence(state.smoothed[candidate], estimate.condition)
    objection = _objection(config, state, estimate, candidate, confidence)
    acting = state.action is Action.ACT
    wants_switch = (objection is not None) if acting else (objection is None)
    resting = state.switched_ns is not None and now_ns - state.switched_ns < config.refractory_ns

    if acting and (not wants_switch or resting):
        verb_index = state.verb_index
        assert verb_index is not None
        kept = config.maps.confidence(state.smoothed[verb_index], estimate.condition)
        return state, GateDecision(Action.ACT, verb_index, kept, HoldReason.NONE)
    if not acting and wants_switch and not resting:
        acted = replace(state, action=Action.ACT, verb_index=candidate, switched_ns=now_ns)
        return acted, GateDecision(Action.ACT, candidate, confidence, HoldReason.NONE)
    return _hold(state, now_ns, confidence, objection or HoldReason.REFRACTORY)


def _objection(
    config: GateConfig, state: GateState, estimate: IntentEstimate, candidate: int, confidence: float
) -> HoldReason | None:
    """The first confidence-driven reason not to act on `candidate`, or None."""
    if candidate in config.vocabulary.never_assisted:
        return HoldReason.VERB_NOT_ASSISTED
    if state.action is Action.ACT and candidate != state.verb_index:
        return HoldReason.VERB_CHANGE
    if _rank(estimate.probabilities, candidate) >= config.top_k:
        return HoldReason.NOT_TOP_K
    threshold = config.tau_off if state.action is Action.ACT else config.tau_on
    if not confidence >= threshold:
        return HoldReason.CONFIDENCE
    return None


def _hold(state: GateState, now_ns: int, confidence: float, reason: HoldReason) -> tuple[GateState, GateDecision]:
    if state.action is Action.ACT:
        state = replace(state, action=Action.HOLD, verb_index=None, switched_ns=now_ns)
    return state, GateDecision(Action.HOLD, None, confidence, reason)


def estimate_problem(config: GateConfig, estimate: IntentEstimate | None, now_ns: int) -> HoldReason | None:
    """Why this estimate cannot be decided on now, or None: there is none, its numbers are none, or it is too old."""
    if estimate is None or _unusable(estimate):
        return HoldReason.NO_ESTIMATE
    # A stamp from the future is a clock that cannot be trusted: as stale as one from the distant past.
    if not 0 <= now_ns - estimate.oldest_input_ns <= config.max_age_ns:
        return HoldReason.STALE
    return None


def _unusable(estimate: IntentEstimate) -> bool:
    """True unless every number is a probability (NaN fails every comparison, so it is unusable too)."""
    numbers = (*estimate.probabilities, estimate.confidence)
    return not (
        0 <= estimate.verb_index < len(estimate.probabilities) and all(0.0 <= number <= 1.0 for number in numbers)
    )


def smooth(alpha: float, previous: tuple[float, ...], newest: tuple[float, ...]) -> tuple[float, ...]:
    """Moving average whose first sample counts fully: a distribution from the first tick on.

    That no ACT follows a gap too soon is not left to it: sensing has to earn trust anew first (`core.sensing`).
    """
    if len(previous) != len(newest):
        return newest
    return tuple(alpha * new + (1.0 - alpha) * old for old, new in zip(previous, newest, strict=True))


def _rank(probabilities: tuple[float, ...], index: int) -> int:
    """How many classes are strictly more likely than `index` in the newest window."""
    own = probabilities[index]
    return sum(probability > own for probability in probabilities)
