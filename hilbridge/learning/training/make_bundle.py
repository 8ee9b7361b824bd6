"""`hilbridge train`: simulated wearers in, a calibrated bundle out. The demo bundle is made by exactly this."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from hilbridge.intent.bundle import Bundle, Thresholds, save_bundle
from hilbridge.intent.calibration import ALL_VALID, Calibration, Method
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.synthetic import record_people
from hilbridge.learning.data.windows import STEPS, window_ends
from hilbridge.learning.training.fit import fit_calibration
from hilbridge.learning.training.network import GruNetwork, export_weights, network_vectors
from hilbridge.learning.training.recipes import DEMO_RECIPE, Recipe
from hilbridge.learning.training.replay import choose_threshold, estimates, replay, stream_logits
from hilbridge.learning.training.train import Trained, fit_network, predict_logits
from hilbridge.records import Modality
from hilbridge.wearer.timeline import BENCHMARK, DEMO, Difficulty

DIFFICULTIES: Mapping[str, Difficulty] = {"demo": DEMO, "benchmark": BENCHMARK}
TAU_BAND = 0.15


@dataclass(frozen=True, slots=True)
class TrainConfig:
    """What `train` needs.

    out: the bundle to write. work: checkpoints, logs and recorded streams (an interrupted run goes on from there).
    wearer: "demo" or "benchmark". people of seeds first_seed.., `seconds` each: 70 % train, 15 % stop and calibrate,
    15 % choose the threshold (no person is in two groups). precision: act-only precision tau_on must replay to.
    """

    out: Path
    work: Path
    wearer: str = "demo"
    people: int = 480
    seconds: float = 60.0
    first_seed: int = 1_000
    precision: float = 0.9
    method: Method = Method.ISOTONIC
    recipe: Recipe = DEMO_RECIPE


def train(config: TrainConfig, console: Console | None = None) -> Path:
    """Record, train, calibrate, choose the threshold and write one bundle. Returns its path.

    Raises ValueError naming the setting that is wrong.
    """
    if config.wearer not in DIFFICULTIES:
        raise ValueError(f"wearer {config.wearer!r}: must be one of {', '.join(DIFFICULTIES)}")
    if config.people < 8:
        raise ValueError(f"people = {config.people}: at least 8, so that every group has someone")
    if config.out.is_dir():
        raise ValueError(f"{config.out}: a folder; name the file of the bundle")
    for folder in (config.out.parent, config.work):  # now, not after hours of training
        folder.mkdir(parents=True, exist_ok=True)
    difficulty = DIFFICULTIES[config.wearer]
    seeds = range(config.first_seed, config.first_seed + config.people)
    held = max(2, round(0.15 * config.people))
    groups = (seeds[: -2 * held], seeds[-2 * held : -held], seeds[-held:])
    with Progress(console=console or Console(stderr=True)) as progress:
        task = progress.add_task("recording simulated wearers", total=config.people)

        def step() -> None:
            progress.advance(task)

        training, validation, choosing = (
            record_people(group, difficulty, config.seconds, config.work / "streams", step) for group in groups
        )
        trained = fit_network(config.recipe, training, validation, config.work, progress=progress)
    bundle = make_bundle(trained, validation, choosing, config.precision, config.method, _provenance(config, trained))
    return save_bundle(bundle, config.out)


def make_bundle(
    trained: Trained,
    calibration_people: Stream,
    threshold_people: Stream,
    precision: float,
    method: Method,
    provenance: Mapping[str, Any],
    note: Callable[[str], None] = lambda _: None,
) -> Bundle:
    """Calibrate on one group of people, choose tau_on on another by replaying the real gate."""
    if not isinstance(trained.network, GruNetwork):
        raise ValueError("only the GRU runs in the bridge; the transformer is an ablation")
    calibration = calibrate(trained, calibration_people, method)
    weights = export_weights(trained.network, trained.logit_offset)
    logits = stream_logits(weights, threshold_people, trained.statistics)
    beliefs = estimates(logits, calibration, ALL_VALID)
    tau_on, result = choose_threshold(beliefs, threshold_people, precision, TAU_BAND)
    note(f"tau_on {tau_on}: act-only precision {result.act_only_precision:.3f}, coverage {result.coverage:.3f}")
    figures = {"act_only_precision": round(result.act_only_precision, 4), "coverage": round(result.coverage, 4)}
    return Bundle(
        weights,
        trained.statistics.mean,
        trained.statistics.std,
        STEPS,
        calibration,
        Thresholds(tau_on, max(0.02, round(tau_on - TAU_BAND, 3))),
        network_vectors(trained.network, trained.logit_offset, trained.statistics.mean, trained.statistics.std, STEPS),
        {**provenance, "threshold_replay": figures},
    )


def calibrate(trained: Trained, people: Stream, method: Method, every: int = 12) -> Calibration:
    """Calibrators from every 12th window of `people`, one temperature for each set of modalities that may be left."""
    ends = window_ends(people, every)
    labels = people.label[ends]
    by_mask = {}
    for lost in (lost for size in range(3) for lost in combinations(Modality, size)):
        mask = ALL_VALID & ~sum(1 << int(modality) for modality in lost)
        logits = predict_logits(trained.network, people, ends, trained.statistics, lost) + trained.logit_offset
        by_mask[mask] = (logits, labels)
    return fit_calibration(by_mask, method)


def replay_bundle(bundle: Bundle, people: Stream) -> dict[str, float]:
    """How a bundle's gate fares on people it has never seen: act-only precision, coverage, false assists per minute."""
    from hilbridge.core.gate import GateConfig
    from hilbridge.learning.data.windows import Statistics

    logits = stream_logits(bundle.weights, people, Statistics(bundle.mean, bundle.std))
    config = GateConfig(tau_on=bundle.thresholds.tau_on, tau_off=bundle.thresholds.tau_off)
    result = replay(config, estimates(logits, bundle.calibration, ALL_VALID), people)
    return {
        "act_only_precision": result.act_only_precision,
        "coverage": result.coverage,
        "false_assists_per_minute": result.false_assists / (len(people) / 25.0 / 60.0),
    }


def _provenance(config: TrainConfig, trained: Trained) -> dict[str, Any]:
    best = min(trained.history, key=lambda row: row["validation_nll"])
    return {
        "origin": "simulated wearer",
        "trained_on": f"simulated wearer, difficulty {config.wearer}",
        "people": config.people,
        "seconds_each": config.seconds,
        "first_seed": config.first_seed,
        "recipe": asdict(config.recipe),
        "validation": {key: round(float(np.asarray(value)), 4) for key, value in best.items()},
        "note": "no real person's data is in this bundle",
    }
