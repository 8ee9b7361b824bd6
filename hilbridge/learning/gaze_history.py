"""What believed history adds to real gaze: no label of the past is given, only what the system thought of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.intent.calibration import softmax
from hilbridge.intent.history import BelievedHistory, HistoryPrior
from hilbridge.learning import metrics
from hilbridge.learning.egtea import GAZE, Action, by_session, load_actions
from hilbridge.learning.fit import fit_temperature
from hilbridge.learning.history import recipe_of
from hilbridge.learning.sessions import gaze_path, session_features, session_stream
from hilbridge.learning.synthetic import Stream, join
from hilbridge.learning.train import Recipe, fit_network, predict_logits
from hilbridge.sensors.begaze import read_begaze
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
    """One subject left out: calibrated gaze posteriors per session, the training marginal and the others' sessions."""

    validation: Sequence[str]
    test: Sequence[str]
    posterior: Mapping[str, Floats]
    marginal: Floats
    others: Sequence[Sequence[Action]]


def evaluate_gaze_with_history(root: Path, recipe: Recipe = GAZE_RECIPE) -> GazeHistoryResult:
    """Gaze alone against gaze with believed history on all sessions that have gaze, leaving one subject out each time."""
    sessions = by_session(load_actions(root))
    names = sorted(path.stem for path in (root / GAZE).glob("*.txt") if path.stem in sessions)
    streams = {name: _gaze_stream(root, name, index, sessions[name]) for index, name in enumerate(names)}
    people = sorted({_person(name) for name in names})
    parts: dict[str, list[Floats]] = {"gaze": [], "history": [], "recipe": [], "marginal": []}
    truth = []
    for number, person in enumerate(people):
        turn = _turn(recipe, sessions, streams, person, people[(number + 1) % len(people)])
        labels = {name: streams[name][0].label[streams[name][1]] for name in turn.posterior}
        overall = transition_prior(turn.others, turn.marginal, 0.0, None).start
        for key, uses_recipe in (("history", False), ("recipe", True)):
            trust = _best_trust(turn, labels, uses_recipe)
            parts[key].extend(_fused(turn, name, trust, uses_recipe) for name in turn.test)
        for name in turn.test:
            parts["gaze"].append(turn.posterior[name])
            parts["marginal"].append(np.tile(overall, (len(labels[name]), 1)))
            truth.append(labels[name])
    t = np.concatenate(truth)
    pooled = {key: np.concatenate(value) for key, value in parts.items()}
    return GazeHistoryResult(
        len(t),
        metrics.nll(pooled["gaze"], t),
        metrics.nll(pooled["history"], t),
        metrics.nll(pooled["recipe"], t),
        metrics.nll(pooled["marginal"], t),
        float((pooled["gaze"].argmax(axis=1) == t).mean()),
        float((pooled["history"].argmax(axis=1) == t).mean()),
    )


def _turn(recipe: Recipe, sessions: Sessions, streams: Streams, person: str, held: str) -> _Turn:
    """Train on everybody but `person` and `held`, calibrate on `held`."""
    training = [name for name in streams if _person(name) not in (person, held)]
    validation = [name for name in streams if _person(name) == held]
    test = [name for name in streams if _person(name) == person]
    (stream, ends), (checked, checked_ends) = _joined(streams, training), _joined(streams, validation)
    trained = fit_network(recipe, stream, checked, None, ends, checked_ends)

    def logits(of: Stream, at: Ints) -> Floats:
        return predict_logits(trained.network, of, at, trained.statistics) + trained.logit_offset

    temperature = fit_temperature(logits(checked, checked_ends), checked.label[checked_ends])
    seen = np.concatenate([stream.label[ends], checked.label[checked_ends]])
    marginal: Floats = np.asarray((np.bincount(seen, minlength=K) + 1.0) / (len(seen) + K), dtype=np.float64)
    posterior = {name: softmax(logits(*streams[name]) / temperature) for name in (*validation, *test)}
    others = [session for session in sessions.values() if session[0].subject != person]
    return _Turn(validation, test, posterior, marginal, others)


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
    recording = read_begaze(gaze_path(root, name))
    values, valid = session_features(int(recording.frame[-1] * 25 // 24) + 1, recording)
    stream, ends, _ = session_stream(number, actions, values, valid)
    return stream, ends


def _joined(streams: Streams, names: Sequence[str]) -> tuple[Stream, Ints]:
    offset, ends = 0, []
    for name in names:
        ends.append(streams[name][1] + offset)
        offset += len(streams[name][0])
    return join(streams[name][0] for name in names), np.concatenate(ends)
