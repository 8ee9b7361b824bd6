"""Training as in the paper ("Training Objective"), seeded and resumable. The command line calls `train`."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from pathlib import Path
from pickle import UnpicklingError
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from rich.progress import Progress
from torch.nn import functional

from hilbridge.errors import InputError
from hilbridge.files import in_place_of
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.windows import Statistics, gather, training_statistics, window_ends
from hilbridge.learning.training.fit import fit_temperature, nll
from hilbridge.learning.training.network import GruNetwork, TransformerNetwork
from hilbridge.learning.training.recipes import Recipe
from hilbridge.records import Modality
from hilbridge.verbs import VERBS

Network = GruNetwork | TransformerNetwork


@dataclass(frozen=True, slots=True)
class Trained:
    """The best network on validation NLL, the statistics and the logit correction it needs, the weights it ended with."""

    network: Network
    statistics: Statistics
    logit_offset: NDArray[np.float64]
    history: tuple[dict[str, float], ...]
    last_weights: Mapping[str, torch.Tensor]


def class_weights(labels: NDArray[np.int64], power: float, verbs: int = len(VERBS)) -> NDArray[np.float64]:
    """w_k proportional to freq(k)^-power with mean 1 over the training windows (K,)."""
    counts = np.bincount(labels, minlength=verbs) + 1.0
    weights = (counts / counts.sum()) ** -power
    return np.asarray(weights / weights[labels].mean())


def build(recipe: Recipe, verbs: int = len(VERBS)) -> Network:
    """An untrained network of the recipe's architecture."""
    if recipe.architecture == "transformer":
        return TransformerNetwork(dropout=recipe.dropout, classes=verbs)
    if recipe.architecture == "gru":
        return GruNetwork(inner=recipe.inner, hidden=recipe.hidden, classes=verbs, dropout=recipe.dropout)
    raise ValueError(f"architecture {recipe.architecture!r}: must be gru or transformer")


def fit_network(
    recipe: Recipe,
    training: Stream,
    validation: Stream,
    folder: Path | None = None,
    windows: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None,
    progress: Progress | None = None,
    stop_after: int | None = None,
) -> Trained:
    """Train until the validation NLL (at its own best temperature) stops falling.

    With `folder`, log to train.csv and resume from checkpoint.pt.
    windows: where the windows to train and to validate on end; default: before each action, and every 12 steps.
    stop_after: leave off after so many epochs although the schedule has more (to go on later).
    """
    torch.set_num_threads(recipe.threads)
    torch.manual_seed(recipe.seed)
    ends, judged = windows or (window_ends(training), window_ends(validation, 12))
    statistics = training_statistics(training.values, training.valid)
    weights = class_weights(training.label[ends], recipe.class_weight_power, training.verbs)
    offset = -np.log(weights)
    network = build(recipe, training.verbs)
    optimiser = torch.optim.AdamW(network.parameters(), lr=recipe.learning_rate, weight_decay=recipe.weight_decay)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, recipe.epochs)
    average = deepcopy(network)
    learner = _Learner(network, average, optimiser)
    state = _Progress(recipe, network, average, optimiser, schedule, folder)
    task = progress.add_task(f"training {recipe.architecture}", total=recipe.epochs) if progress else None
    for epoch in range(state.resume(), min(recipe.epochs, stop_after or recipe.epochs)):
        if state.since_best >= recipe.patience:
            break
        loss = _epoch(recipe, learner, training, ends, statistics, weights, epoch)
        schedule.step()
        logits = predict_logits(average, validation, judged, statistics) + offset
        labels = validation.label[judged]
        top1 = float((logits.argmax(axis=1) == labels).mean())
        # A common factor of the logits is calibration's to remove: judge what will be left after it.
        calibrated = nll(logits / fit_temperature(logits, labels), labels)
        state.record(epoch, {"epoch": epoch, "loss": loss, "validation_nll": calibrated, "top1": top1})
        if progress is not None and task is not None:
            progress.update(task, completed=epoch + 1, description=f"validation NLL {state.best:.3f}")
    if progress is not None and task is not None:
        progress.update(task, completed=recipe.epochs)
    last = {name: value.clone() for name, value in average.state_dict().items()}
    network.load_state_dict(state.best_weights)
    network.eval()
    return Trained(network, statistics, offset, tuple(state.history), last)


def predict_logits(
    network: Network,
    stream: Stream,
    ends: NDArray[np.int64],
    statistics: Statistics,
    lost: tuple[Modality, ...] = (),
    batch: int = 512,
) -> NDArray[np.float64]:
    """Logits (N, K) of the windows that end at `ends`, without the logit correction."""
    network.eval()
    parts = []
    with torch.inference_mode():
        for start in range(0, len(ends), batch):
            x, usable = gather(stream, ends[start : start + batch], statistics, lost)
            parts.append(network(torch.from_numpy(x), torch.from_numpy(usable)).numpy().astype(np.float64))
    return np.concatenate(parts) if parts else np.zeros((0, network.head.out_features))


class _Learner(NamedTuple):
    """The network that learns, the moving average of its weights, and what moves them."""

    network: Network
    average: Network
    optimiser: torch.optim.Optimizer


def _epoch(
    recipe: Recipe,
    learner: _Learner,
    training: Stream,
    ends: NDArray[np.int64],
    statistics: Statistics,
    weights: NDArray[np.float64],
    epoch: int,
) -> float:
    """One epoch over freshly drawn windows; everything random comes from (seed, epoch), so resuming changes nothing."""
    network, average, optimiser = learner
    rng = np.random.default_rng([recipe.seed, epoch])
    torch.manual_seed(recipe.seed * 100_003 + epoch)
    count = min(recipe.windows_per_epoch, len(ends))
    chosen = rng.permutation(ends)[:count]
    weight = torch.from_numpy(weights.astype(np.float32))
    network.train()
    losses = []
    for start in range(0, count, recipe.batch):
        part = chosen[start : start + recipe.batch]
        x, usable = gather(training, part, statistics, rng=rng, dropout=recipe.modality_dropout)
        if recipe.jitter > 0.0:
            x += (x != 0.0) * rng.normal(0.0, recipe.jitter, size=(len(part), 1, x.shape[2])).astype(np.float32)
        logits = network(torch.from_numpy(x), torch.from_numpy(usable))
        target = torch.from_numpy((training.bayes if recipe.taught else training.label)[part])
        loss = functional.cross_entropy(logits, target, weight, label_smoothing=recipe.label_smoothing)
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(network.parameters(), recipe.clip_norm)
        optimiser.step()
        _follow(average, network, recipe.averaging)
        losses.append(float(loss.detach()))
    return float(np.mean(losses))


def _follow(average: Network, network: Network, decay: float) -> None:
    """One step of the exponential moving average of the weights."""
    with torch.no_grad():
        for kept, newest in zip(average.parameters(), network.parameters(), strict=True):
            kept.lerp_(newest, 1.0 - decay)


class _Progress:
    """The best weights so far, the log and the checkpoint."""

    def __init__(
        self,
        recipe: Recipe,
        network: Network,
        average: Network,
        optimiser: torch.optim.Optimizer,
        schedule: torch.optim.lr_scheduler.LRScheduler,
        folder: Path | None,
    ) -> None:
        self._recipe, self._network, self._average = recipe, network, average
        self._optimiser, self._schedule = optimiser, schedule
        self._folder = folder
        self.history: list[dict[str, float]] = []
        self.best = float("inf")
        self.since_best = 0
        self.best_weights = {name: value.clone() for name, value in network.state_dict().items()}

    def record(self, epoch: int, row: dict[str, float]) -> None:
        self.history.append(row)
        if row["validation_nll"] < self.best:
            self.best, self.since_best = row["validation_nll"], 0
            self.best_weights = {name: value.clone() for name, value in self._average.state_dict().items()}
        else:
            self.since_best += 1
        if self._folder is not None:
            self._save(self._folder, epoch)

    def resume(self) -> int:
        """The epoch to go on with: 0, or after the last one of a checkpoint of the very same recipe."""
        path = None if self._folder is None else self._folder / "checkpoint.pt"
        if path is None or not path.is_file():
            return 0
        try:
            stored = torch.load(path, weights_only=True)
            if stored["recipe"] != json.dumps(asdict(self._recipe), sort_keys=True):
                return 0
        except (OSError, RuntimeError, ValueError, EOFError, KeyError, TypeError, UnpicklingError):
            raise InputError(f"{path}: not a checkpoint of ours; remove it, and training begins anew") from None
        self._network.load_state_dict(stored["network"])
        self._average.load_state_dict(stored["average"])
        self._optimiser.load_state_dict(stored["optimiser"])
        self._schedule.load_state_dict(stored["schedule"])
        self.history, self.best = stored["history"], stored["best"]
        self.since_best, self.best_weights = stored["since_best"], stored["best_weights"]
        return int(stored["epoch"]) + 1

    def _save(self, folder: Path, epoch: int) -> None:
        state = {
            "recipe": json.dumps(asdict(self._recipe), sort_keys=True),
            "epoch": epoch,
            "network": self._network.state_dict(),
            "average": self._average.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "schedule": self._schedule.state_dict(),
            "history": self.history,
            "best": self.best,
            "since_best": self.since_best,
            "best_weights": self.best_weights,
        }
        with in_place_of(folder / "checkpoint.pt") as partial, partial.open("wb") as file:
            torch.save(state, file)
        write_csv(folder / "train.csv", self.history)


def write_csv(path: Path, rows: Sequence[dict[str, float]]) -> None:
    """Rows with the same keys, as CSV."""
    with in_place_of(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
