"""What believed history adds to real gaze: no label of the past is given, only what the system thought of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.confidence import ALL_VALID
from hilbridge.intent.calibration import softmax
from hilbridge.intent.history import BelievedHistory, HistoryPrior
from hilbridge.learning import metrics
from hilbridge.learning.calibrators import Method
from hilbridge.learning.data.egtea import Action, DatasetError, by_session, load_actions
from hilbridge.learning.data.sessions import folds, load_features, recorded_sessions, session_stream
from hilbridge.learning.data.stream import Stream, join
from hilbridge.learning.experiments.annotated_history import recipe_of
from hilbridge.learning.training.fit import fit_calibration, fit_temperature
from hilbridge.learning.training.recipes import Recipe
from hilbridge.learning.training.train import fit_network, predict_logits
from hilbridge.records import Modality
from hilbridge.verbs import VERBS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Sessions = Mapping[str, Sequence[Action]]
Streams = Mapping[str, tuple[Stream, Ints]]
K = len(VERBS)
TRUSTS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
GAZE_RECIPE = Recipe(
    hidden=32, inner=16, epochs=8, modality_dropout=0.0, class_weight_power=0.0, seed=1, learning_rate=2e-3
)


@dataclass(frozen=True, slots=True)
class GazeHistoryResult:
    """NLL on the real gaze sessions, every subject tested by networks that never saw them."""

    windows: int
    gaze_nll: float
    history_nll: float
    history_recipe_nll: float
    marginal_nll: float
    gaze_top1: float
    history_top1: float


def transition_prior(
    sessions: Sequence[Sequence[Action]], marginal: Floats, trust: float, recipe: str | None
) -> HistoryPrior:
    """Transitions counted in annotated sessions; those of one recipe lean on those of all with the weight of 8 actions."""
    counts = np.zeros((K, K))
    own = np.zeros((K, K))
    for session in sessions:
        for before, after in pairwise(session):
            counts[before.label, after.label] += 1.0
            own[before.label, after.label] += recipe is not None and recipe_of(before.session) == recipe
    overall = counts.sum(axis=0) / counts.sum()
    general = counts + 2.0 * overall
    general /= general.sum(axis=1, keepdims=True)
    table = own + 8.0 * general
    table /= table.sum(axis=1, keepdims=True)
    return HistoryPrior(table if recipe is not None else general, overall / overall.sum(), marginal, trust)


def fused_session(prior: HistoryPrior, probabilities: Floats) -> Floats:
    """Belief about each action of a session in order, history being only what was believed of the ones before."""
    history = BelievedHistory(prior)
    made = []
    for row in probabilities:
        fused = history.fuse(row)
        history.advance(fused)
        made.append(fused)
    return np.array(made)


@dataclass(frozen=True, slots=True)
class _Turn:
    """One split: raw logits and calibrated posteriors per session, the training marginal, the other people's sessions."""

    validation: Sequence[str]
    test: Sequence[str]
    logits: Mapping[str, Floats]
    posterior: Mapping[str, Floats]
    marginal: Floats
    others: Sequence[Sequence[Action]]


@dataclass(frozen=True, slots=True)
class RealWindows:
    """Every real window with features, predicted by networks and calibrators that never saw its person.

    confidence: by calibrator, (N,); probabilities: by predictor, (N, K); labels, subject (N,); modalities that were there.
    """

    labels: Ints
    subject: Ints
    logits: Floats
    confidence: Mapping[Method, Floats]
    probabilities: Mapping[str, Floats]
    modalities: tuple[str, ...]
    people: int
    splits: str

    def summary(self) -> GazeHistoryResult:
        """The sensors alone against the sensors with believed history."""
        t, pooled = self.labels, self.probabilities
        return GazeHistoryResult(
            len(t),
            *(metrics.nll(pooled[key], t) for key in ("sensors", "history", "recipe", "marginal")),
            *(float((pooled[key].argmax(axis=1) == t).mean()) for key in ("sensors", "history")),
        )


def evaluate_gaze_with_history(root: Path, recipe: Recipe = GAZE_RECIPE) -> GazeHistoryResult:
    """Sensors alone against sensors with believed history on all sessions that have features (see `real_windows`)."""
    return real_windows(root, recipe).summary()


def real_windows(root: Path, recipe: Recipe = GAZE_RECIPE, say: Callable[[str], None] = lambda _: None) -> RealWindows:
    """Train, calibrate and test on people kept apart, on every annotated session of which features are there.

    With 12 people or more: folds of four to test and four to calibrate that test everybody once (with all 32: eight
    folds of 24/4/4); with fewer, one person out to test and one to calibrate, in turn. Raises DatasetError for fewer than 3.
    """
    sessions = by_session(load_actions(root))
    names = [name for name in recorded_sessions(root) if name in sessions]
    people = sorted({_person(name) for name in names})
    if len(people) < 3:
        raise DatasetError(
            f"{root}: features of {len(people)} people; at least 3 are needed to train, calibrate and test"
        )
    say(f"features of {len(names)} sessions of {len(people)} people")
    streams = {name: _gaze_stream(root, name, people.index(_person(name)), sessions[name]) for name in names}
    parts: dict[str, list[Floats]] = {name: [] for name in ("logits", "sensors", "history", "recipe", "marginal")}
    confidence: dict[Method, list[Floats]] = {method: [] for method in Method}
    tested: list[str] = []
    for number, (test, held) in enumerate(splits := _splits(people)):
        say(f"split {number + 1} of {len(splits)}")
        turn = _turn(recipe, sessions, streams, test, held)
        labels = {name: streams[name][0].label[streams[name][1]] for name in turn.posterior}
        fitted = fit_calibration({ALL_VALID: _pairs(turn.logits, labels, turn.validation)}, Method.ISOTONIC)
        overall = transition_prior(turn.others, turn.marginal, 0.0, None).start
        for key, uses_recipe in (("history", False), ("recipe", True)):
            trust = _best_trust(turn, labels, uses_recipe)
            parts[key].extend(_fused(turn, name, trust, uses_recipe) for name in turn.test)
        for name in turn.test:
            parts["logits"].append(turn.logits[name])
            parts["sensors"].append(turn.posterior[name])
            parts["marginal"].append(np.tile(overall, (len(labels[name]), 1)))
            for method in Method:
                confidence[method].append(replace(fitted, method=method).confidence(turn.logits[name], ALL_VALID))
        tested.extend(turn.test)
    pooled = {key: np.concatenate(value) for key, value in parts.items()}
    valid = np.concatenate([streams[name][0].valid for name in names])
    return RealWindows(
        np.concatenate([streams[name][0].label[streams[name][1]] for name in tested]),
        np.concatenate([streams[name][0].subject[streams[name][1]] for name in tested]),
        pooled.pop("logits"),
        {method: np.concatenate(value) for method, value in confidence.items()},
        pooled,
        tuple(modality.name.lower() for modality in Modality if valid[:, int(modality)].any()),
        len(people),
        f"{len(splits)} splits",
    )


def _splits(people: Sequence[str]) -> list[tuple[frozenset[str], frozenset[str]]]:
    """(test, validation) people of every split."""
    if len(people) >= 12:
        return [(fold["test"], fold["validation"]) for fold in folds(people, len(people) // 4)]
    turned = [*people[1:], people[0]]
    return [(frozenset({test}), frozenset({held})) for test, held in zip(people, turned, strict=True)]


def _pairs(logits: Mapping[str, Floats], labels: Mapping[str, Ints], names: Sequence[str]) -> tuple[Floats, Ints]:
    return np.concatenate([logits[name] for name in names]), np.concatenate([labels[name] for name in names])


def _turn(recipe: Recipe, sessions: Sessions, streams: Streams, tested: frozenset[str], held: frozenset[str]) -> _Turn:
    """Train on everybody but those `tested` and `held`, calibrate on `held`."""
    training = [name for name in streams if _person(name) not in tested | held]
    validation = [name for name in streams if _person(name) in held]
    test = [name for name in streams if _person(name) in tested]
    (stream, ends), (checked, checked_ends) = _joined(streams, training), _joined(streams, validation)
    trained = fit_network(recipe, stream, checked, None, (ends, checked_ends))
    logits = {
        name: predict_logits(trained.network, *streams[name], trained.statistics) + trained.logit_offset
        for name in (*validation, *test)
    }
    fitted = np.concatenate([logits[name] for name in validation])
    temperature = fit_temperature(fitted, checked.label[checked_ends])
    seen = np.concatenate([stream.label[ends], checked.label[checked_ends]])
    marginal: Floats = np.asarray((np.bincount(seen, minlength=K) + 1.0) / (len(seen) + K), dtype=np.float64)
    posterior = {name: softmax(own / temperature) for name, own in logits.items()}
    others = [session for session in sessions.values() if session[0].subject not in tested]
    return _Turn(validation, test, logits, posterior, marginal, others)


def _fused(turn: _Turn, name: str, trust: float, uses_recipe: bool) -> Floats:
    prior = transition_prior(turn.others, turn.marginal, trust, recipe_of(name) if uses_recipe else None)
    return fused_session(prior, turn.posterior[name])


def _best_trust(turn: _Turn, labels: Mapping[str, Ints], uses_recipe: bool) -> float:
    """The trust in the sensors that suits the validation subject."""

    def loss(trust: float) -> float:
        return sum(
            metrics.nll(_fused(turn, name, trust, uses_recipe), labels[name]) * len(labels[name])
            for name in turn.validation
        )

    return min(TRUSTS, key=loss)


def _person(session: str) -> str:
    return session.split("-", 1)[0]


def _gaze_stream(root: Path, name: str, number: int, actions: Sequence[Action]) -> tuple[Stream, Ints]:
    stream, ends, _ = session_stream(number, actions, *load_features(root, name))
    return stream, ends


def _joined(streams: Streams, names: Sequence[str]) -> tuple[Stream, Ints]:
    offset, ends = 0, []
    for name in names:
        ends.append(streams[name][1] + offset)
        offset += len(streams[name][0])
    return join(streams[name][0] for name in names), np.concatenate(ends)
