"""The synthetic benchmark: networks trained once and all they say about people they never saw, kept on disk.

An interrupted run goes on with what is there. People to train on, to stop by, to calibrate on and to test are different
people; only those to train on prepare more clearly than the paper's figures suggest (see `BENCHMARK_TRAINING`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from hilbridge.confidence import ALL_VALID
from hilbridge.features.layout import LAYOUT_HASH
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.synthetic import record_people
from hilbridge.learning.data.windows import onset_ends, window_ends
from hilbridge.learning.experiments.laplace import dropout_probabilities, last_layer_laplace
from hilbridge.learning.training.network import GruNetwork, export_weights
from hilbridge.learning.training.recipes import BENCHMARK_RECIPE, OVERFIT_RECIPE, PAPER_RECIPE, PEOPLE_RECIPE, Recipe
from hilbridge.learning.training.replay import stream_logits
from hilbridge.learning.training.train import Trained, fit_network, predict_logits
from hilbridge.records import Modality
from hilbridge.wearer.timeline import BENCHMARK, BENCHMARK_TRAINING

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

VALIDATION_SEED, CALIBRATION_SEED, TEST_SEED, TRAINING_SEED, REPLAY_SEED = 3_000, 3_100, 3_300, 4_000, 5_500
JUDGED = ("calibration", "test")
LOSSES: tuple[tuple[Modality, ...], ...] = ((), (Modality.GAZE,), (Modality.HANDS,), (Modality.SCENE,))


@dataclass(frozen=True, slots=True)
class FoldShape:
    """Three folds: the paper's recipe and another, people, so many of them to test and to stop by in each fold."""

    recipes: tuple[Recipe, Recipe] = (PAPER_RECIPE, PEOPLE_RECIPE)
    seconds: float = 900.0
    people: int = 32
    held: int = 4


@dataclass(frozen=True, slots=True)
class Plan:
    """How large the benchmark is: people of each kind with `seconds` of windows before onsets; `replayed` people of
    `stream_seconds`, every step of them, for E5, and as many again to fit on;
    how many simulated certifications; paper: the folds of its recipe."""

    training: int = 160
    validation: int = 16
    calibration: int = 96
    test: int = 96
    seconds: float = 900.0
    replayed: int = 24
    stream_seconds: float = 60.0
    recipe: Recipe = BENCHMARK_RECIPE
    overfit: Recipe = OVERFIT_RECIPE
    overfit_people: int = 8
    certificates: int = 100
    paper: FoldShape = FoldShape()

    def seeds(self) -> dict[str, range]:
        """The people of each part; nobody is in two of them."""
        return {
            "training": range(TRAINING_SEED, TRAINING_SEED + self.training),
            "validation": range(VALIDATION_SEED, VALIDATION_SEED + self.validation),
            "calibration": range(CALIBRATION_SEED, CALIBRATION_SEED + self.calibration),
            "test": range(TEST_SEED, TEST_SEED + self.test),
            "validation_stream": range(REPLAY_SEED, REPLAY_SEED + self.replayed),
            "stream": range(REPLAY_SEED + self.replayed, REPLAY_SEED + 2 * self.replayed),
        }


def people(plan: Plan, part: str, folder: Path, seeds: Iterable[int] | None = None) -> Stream:
    """The streams of one part, recorded if they are not there yet."""
    whole = part.endswith("stream")
    return record_people(
        plan.seeds()[part] if seeds is None else seeds,
        BENCHMARK_TRAINING if part == "training" else BENCHMARK,
        plan.stream_seconds if whole else plan.seconds,
        folder / "streams",
        whole_seconds=None if whole else 0.0,
    )


def near_onset(stream: Stream) -> Ints:
    """Training windows: the paper's, and those that end up to 0.24 s earlier (their verb is prepared already)."""
    ends = window_ends(stream)
    return np.asarray(ends[(stream.onset_steps[ends] >= 13) & (stream.onset_steps[ends] <= 19)])


def network_path(plan: Plan, folder: Path, kind: str) -> Path:
    """Where one network's answers are kept: another plan, other people or other features have another file."""
    shape = replace(plan, certificates=0, paper=FoldShape()), BENCHMARK, BENCHMARK_TRAINING, LAYOUT_HASH
    return folder / f"network-{kind}.{hashlib.sha256(repr(shape).encode()).hexdigest()[:10]}.npz"


def run_network(plan: Plan, folder: Path, kind: str = "gru") -> Path:
    """Train one network and keep all it says about people it has never seen.

    kind: gru, overfit, transformer, member-N, or taught (by the best possible belief: what these windows let through).
    The file has, for each part of JUDGED: labels, subject, bayes, and logits without each loss of LOSSES.
    """
    path = network_path(plan, folder, kind)
    if path.is_file():
        return path
    special = {
        "overfit": plan.overfit,
        # Attention does not learn at the GRU's rate: the paper's.
        "transformer": replace(plan.recipe, architecture="transformer", learning_rate=1e-3, weight_decay=1e-2),
        "taught": replace(plan.recipe, taught=True),
    }
    recipe = special.get(kind, plan.recipe)
    if kind.startswith("member-"):
        recipe = replace(recipe, seed=int(kind.removeprefix("member-")))
    # So that everything stays affordable; without the labels' noise half the epochs do as well.
    share = {"gru": 1, "overfit": 1, "taught": 2}.get(kind, 3)
    recipe = replace(recipe, epochs=max(1, recipe.epochs // share))
    parts = {part: people(plan, part, folder) for part in ("validation", *JUDGED)}
    seeds = plan.seeds()["training"]
    parts["training"] = people(plan, "training", folder, seeds[: plan.overfit_people] if kind == "overfit" else seeds)
    ends = onset_ends(parts["training"]) if kind == "overfit" else near_onset(parts["training"])
    judged = onset_ends(parts["validation"])
    trained = fit_network(recipe, parts["training"], parts["validation"], path.with_suffix(""), (ends, judged))
    if kind == "overfit":
        trained = _last_epoch(trained)
    kept: dict[str, NDArray[Any]] = {}
    for part in JUDGED:
        kept.update(_judged(trained, parts[part], part))
    if kind == "gru":
        kept.update(_extras(plan, folder, trained, parts))
    partial = path.with_suffix(".partial.npz")
    np.savez_compressed(partial, allow_pickle=False, **kept)
    partial.replace(path)
    return path


def _last_epoch(trained: Trained) -> Trained:
    """Overfitting means not to stop early: the weights of the last epoch, not of the best."""
    trained.network.load_state_dict(trained.last_weights)
    return trained


def _judged(trained: Trained, stream: Stream, part: str) -> dict[str, NDArray[Any]]:
    ends = onset_ends(stream)
    kept: dict[str, NDArray[Any]] = {
        f"{part}_label": stream.label[ends],
        f"{part}_subject": stream.subject[ends],
        f"{part}_bayes": stream.bayes[ends],
    }
    for lost in LOSSES:
        logits = predict_logits(trained.network, stream, ends, trained.statistics, lost) + trained.logit_offset
        kept[f"{part}_logits_{mask_of(lost)}"] = logits
    return kept


def _extras(plan: Plan, folder: Path, trained: Trained, parts: dict[str, Stream]) -> dict[str, NDArray[Any]]:
    """What only the main network is asked for: streams for E5, Laplace, MC dropout."""
    assert isinstance(trained.network, GruNetwork)
    test = parts["test"]
    weights = export_weights(trained.network, trained.logit_offset)
    ends = onset_ends(test)
    laplace = last_layer_laplace(
        trained,
        parts["training"],
        near_onset(parts["training"])[::8],
        test,
        ends,
        parts["calibration"],
        onset_ends(parts["calibration"]),
    )
    kept: dict[str, NDArray[Any]] = {}
    for prefix in ("stream", "validation_stream"):
        stream = people(plan, prefix, folder)
        kept.update({f"{prefix}_{name}": value for name, value in stream_arrays(stream).items()})
        kept[f"{prefix}_logits"] = stream_logits(weights, stream, trained.statistics)
    kept["laplace_probabilities"] = laplace.probabilities
    kept["laplace_calibration"] = laplace.calibration
    kept["laplace_prior"] = np.array([laplace.prior_precision])
    kept["dropout_probabilities"] = dropout_probabilities(trained, test, ends)
    kept["dropout_calibration"] = dropout_probabilities(trained, parts["calibration"], onset_ends(parts["calibration"]))
    for layer, value in laplace.curvature.items():
        kept[f"curvature_{layer}"] = np.array(value)
    torch.set_num_threads(1)
    return kept


def mask_of(lost: tuple[Modality, ...]) -> int:
    """The bit mask of what is left."""
    return ALL_VALID & ~sum(1 << int(modality) for modality in lost)


def stream_arrays(stream: Stream) -> dict[str, NDArray[Any]]:
    """The arrays of a stream by name."""
    return {name: getattr(stream, name) for name in Stream.__dataclass_fields__}
