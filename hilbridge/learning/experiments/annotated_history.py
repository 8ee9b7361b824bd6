"""How far the verbs before predict the next one, on real annotations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression
from threadpoolctl import threadpool_limits

from hilbridge.intent.calibration import softmax
from hilbridge.learning import metrics
from hilbridge.learning.data.egtea import Action, by_session, subjects
from hilbridge.learning.data.sessions import folds
from hilbridge.learning.training.fit import fit_temperature
from hilbridge.verbs import VERBS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
K = len(VERBS)
DEPTH = 4
DECAY = 0.8
LEAD_MS = 500


@dataclass(frozen=True, slots=True)
class HistoryResult:
    """Pooled over all folds' test subjects."""

    windows: int
    top1: float
    top1_interval: tuple[float, float]
    top5: float
    nll: float
    ece15: float
    debiased_ece: float
    noise_floor: float


def recipe_of(session: str) -> str:
    """The third part of a session's name, e.g. GreekSalad."""
    return session.rsplit("-", 1)[-1]


def history_features(session: Sequence[Action], recipes: Sequence[str]) -> Floats:
    """One row per action: what was annotated to have begun until 0.5 s before its onset. (N, F).

    Nothing of a row is known later than that: not when an action that is under way then will end.
    """
    rows = []
    for action in session:
        seen = [before for before in session if before.start_ms <= action.start_ms - LEAD_MS and before is not action]
        recent = np.zeros((DEPTH, K + 1))
        for place in range(DEPTH):
            recent[place, seen[-1 - place].label if len(seen) > place else K] = 1.0
        faded = np.zeros(K)
        for age, before in enumerate(reversed(seen[-12:])):
            faded[before.label] += DECAY**age
        now_ms = action.start_ms - LEAD_MS
        # When what is under way will end is not known yet; since when it is under way is.
        under_way = bool(seen) and seen[-1].end_ms > now_ms
        gap_s = 0.0 if under_way else (now_ms - seen[-1].end_ms) / 1000.0 if seen else 5.0
        since_s = (now_ms - seen[-1].start_ms) / 1000.0 if under_way else 0.0
        by_last = np.zeros((2, K))
        if seen:
            by_last[:, seen[-1].label] = np.log1p(gap_s), under_way
        recipe = np.array([float(recipe_of(action.session) == name) for name in recipes])
        gap = [np.log1p(gap_s), np.log1p(since_s), gap_s > 0, gap_s > 2, gap_s > 5]
        rows.append(np.concatenate([recent.ravel(), faded, recipe, gap, [np.log1p(len(seen)) / 5], by_last.ravel()]))
    return np.array(rows, dtype=np.float64)


def evaluate_history(actions: Sequence[Action], count: int = 8) -> HistoryResult:
    """Subject-disjoint: logistic model on the training subjects, temperature on the validation ones, judged on the rest."""
    recipes = sorted({recipe_of(action.session) for action in actions})
    rows: dict[str, list[Floats]] = {}
    labels: dict[str, list[Ints]] = {}
    for session in by_session(actions).values():
        rows.setdefault(session[0].subject, []).append(history_features(session, recipes))
        labels.setdefault(session[0].subject, []).append(np.array([action.label for action in session]))
    probabilities: list[Floats] = []
    truth: list[Ints] = []
    subject: list[Ints] = []
    for fold in folds(subjects(actions), count):
        names = {part: sorted(members) for part, members in fold.items()}
        x, y = (
            {part: np.concatenate([each for name in own for each in table[name]]) for part, own in names.items()}
            for table in (rows, labels)
        )
        # One thread: these matrices are small, and threads that wait for each other cost more than they give.
        with threadpool_limits(1):
            model = LogisticRegression(C=0.3, max_iter=200).fit(x["train"], y["train"])

        def logits(values: Floats, model: LogisticRegression = model) -> Floats:
            made = np.full((len(values), K), -12.0)
            made[:, model.classes_] = model.decision_function(values)
            return made

        temperature = fit_temperature(logits(x["validation"]), y["validation"])
        probabilities.append(softmax(logits(x["test"]) / temperature))
        truth.append(y["test"])
        subject.append(
            np.concatenate(
                [np.full(len(each), index) for index, name in enumerate(names["test"]) for each in labels[name]]
            )
            + 100 * len(subject)
        )
    p, t, s = np.concatenate(probabilities), np.concatenate(truth), np.concatenate(subject)
    confidence, right = p.max(axis=1), p.argmax(axis=1) == t
    return HistoryResult(
        len(t),
        float(right.mean()),
        metrics.bootstrap(lambda index: float(right[index].mean()), s),
        metrics.top_k(p, t, 5),
        metrics.nll(p, t),
        metrics.ece(confidence, right),
        metrics.debiased_ece(confidence, right),
        metrics.noise_floor(confidence),
    )
