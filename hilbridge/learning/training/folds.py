"""`train --data`: networks by fold so that everybody is judged by one that never met them, then one network of all.

Temperatures, maps, threshold and report stand on the pooled out-of-fold streams. Early stopping has people of its own within
each fold; they serve nothing else there, and are judged by the network of their own fold.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from hilbridge.cluster import run_all, workers
from hilbridge.errors import InputError
from hilbridge.features.layout import LAYOUT_HASH
from hilbridge.files import in_place_of
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.windows import window_ends
from hilbridge.learning.training.gate_fit import LOSSES, logits_by_loss
from hilbridge.learning.training.make_bundle import network_weights
from hilbridge.learning.training.recipes import Recipe
from hilbridge.learning.training.train import Trained, fit_network
from hilbridge.records import Modality

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Say = Callable[[str], None]
LEAD_STEPS = 13
STOPPING_SHARE = 0.15
JUDGED_EVERY = 12


@dataclass(frozen=True, slots=True)
class FoldPlan:
    """How people are trained on: folds at most so many; onset_windows_only is the paper's, else every busy step counts.
    jobs, cluster: where (`hilbridge.cluster`); on a cluster, checkpoints of folds are of use where all see the same files."""

    recipe: Recipe
    folds: int = 5
    onset_windows_only: bool = False
    jobs: int = 1
    cluster: str | None = None


@dataclass(frozen=True, slots=True)
class Folded:
    """logits: out of fold, for each of `losses`, (N, K) over the people's stream; final: trained on all."""

    logits: tuple[Floats, ...]
    losses: tuple[tuple[Modality, ...], ...]
    final: Trained
    folds: int
    epochs: int


def losses_of(stream: Stream) -> tuple[tuple[Modality, ...], ...]:
    """The losses of modalities that leave something, each outcome once; a data set may never have had some of them."""
    there = [modality for modality in Modality if stream.valid[:, int(modality)].any()]
    if not there:
        raise InputError("--data: no step of any session has valid gaze, hands or scene; check what was recorded")
    kept: dict[frozenset[Modality], tuple[Modality, ...]] = {}
    for lost in LOSSES:
        left = frozenset(there) - frozenset(lost)
        if left:
            kept.setdefault(left, lost)
    return tuple(kept.values())


def train_folds(plan: FoldPlan, stream: Stream, key: str, work: Path, say: Say = lambda _: None) -> Folded:
    """Train and judge. key: what the streams were made from; what `work` holds of another key or plan is done again.

    Raises InputError for too few labelled windows.
    """
    people = np.unique(stream.subject)
    count = min(plan.folds, len(people))
    order = np.random.default_rng(6).permutation(people)
    groups = [order[start::count] for start in range(count)]
    losses = losses_of(stream)
    work.mkdir(parents=True, exist_ok=True)
    say(f"training {count} folds of {len(people)} people, {len(_training_ends(plan, stream))} windows")
    parts = [
        (plan, stream, group, losses, (work / _name(plan, key, number)).absolute())
        for number, group in enumerate(groups)
    ]
    with workers(plan.jobs, plan.cluster) as pools:
        made = run_all(pools, _fold, parts, "training")
    logits = [np.full((len(stream), made[0][0].shape[2]), np.nan) for _ in losses]
    for group, (own, _) in zip(groups, made, strict=True):
        where = np.isin(stream.subject, group)
        for place in range(len(losses)):
            logits[place][where] = own[place]
    epochs = max(1, round(float(np.mean([best for _, best in made]))) + 1)
    say(f"training the network of all people, {epochs} epochs: as many as were best in the folds")
    return Folded(tuple(logits), losses, _final(plan, stream, epochs, work / _name(plan, key, "all")), count, epochs)


def _name(plan: FoldPlan, key: str, part: int | str) -> str:
    shape = json.dumps([asdict(replace(plan, jobs=1, cluster=None)), key, LAYOUT_HASH], sort_keys=True)
    return f"fold-{part}.{hashlib.sha256(shape.encode()).hexdigest()[:12]}"


def _fold(
    plan: FoldPlan, stream: Stream, judged: Ints, losses: Sequence[tuple[Modality, ...]], place: Path
) -> tuple[Floats, int]:
    """Out-of-fold logits (losses, n, K) of the people `judged`, and the best epoch."""
    kept = place.with_suffix(place.suffix + ".npz")
    if kept.is_file():
        try:
            with np.load(kept) as stored:
                return stored["logits"], int(stored["epoch"])
        except (OSError, ValueError, KeyError, EOFError, BadZipFile):
            raise InputError(f"{kept}: not a fold of ours; remove it, and the fold is trained anew") from None
    rest = [person for person in np.unique(stream.subject) if person not in judged]
    stopping = rest[:: max(2, round(1 / STOPPING_SHARE))] if len(rest) > 1 else rest
    training = [person for person in rest if person not in stopping] or rest
    parts = {name: stream.part(np.isin(stream.subject, own)) for name, own in (("train", training), ("stop", stopping))}
    ends = _training_ends(plan, parts["train"]), _busy_ends(parts["stop"])[::JUDGED_EVERY]
    for name, own in zip(parts, ends, strict=True):
        if not len(own):
            raise InputError(f"--data: too few labels to {name} by in one of the folds; label more sessions")
    trained = fit_network(plan.recipe, parts["train"], parts["stop"], place, ends)
    epoch = int(min(trained.history, key=lambda row: row["validation_nll"])["epoch"])
    tested = stream.part(np.isin(stream.subject, judged))
    logits = np.stack(logits_by_loss(network_weights(trained), trained.statistics, tested, losses))
    with in_place_of(kept) as partial, partial.open("wb") as file:
        np.savez_compressed(file, logits=logits, epoch=np.array(epoch))
    return logits, epoch


def _final(plan: FoldPlan, stream: Stream, epochs: int, place: Path) -> Trained:
    """The network of all people. Nobody is left to stop by: the folds said for how long."""
    recipe = replace(plan.recipe, epochs=epochs, patience=epochs + 1)
    ends = _training_ends(plan, stream)
    trained = fit_network(recipe, stream, stream, place, (ends, _busy_ends(stream)[:: 10 * JUDGED_EVERY]))
    trained.network.load_state_dict(trained.last_weights)
    trained.network.eval()
    return trained


def _busy_ends(stream: Stream) -> Ints:
    """Windows that end while the wearer does or prepares something that is labelled."""
    ends = window_ends(stream)
    return np.asarray(ends[stream.known[ends] & (stream.event[ends] >= 0)])


def _training_ends(plan: FoldPlan, stream: Stream) -> Ints:
    ends = _busy_ends(stream)
    return np.asarray(ends[stream.onset_steps[ends] == LEAD_STEPS]) if plan.onset_windows_only else ends
