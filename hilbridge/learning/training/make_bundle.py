"""`hilbridge train`: simulated wearers in, a calibrated bundle out. The demo bundle is made by exactly this."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

import hilbridge
from hilbridge.core.gate import GateConfig
from hilbridge.intent.bundle import Bundle, Thresholds, save_bundle
from hilbridge.intent.gru import Weights
from hilbridge.intent.provenance import Origin, Provenance
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.synthetic import record_people
from hilbridge.learning.data.windows import STEPS, Statistics
from hilbridge.learning.training.gate_fit import GATE, TAU_BAND, Calibrated, calibrate, logits_by_loss, replays
from hilbridge.learning.training.network import GruNetwork, export_weights, network_vectors
from hilbridge.learning.training.person import actions_of, fit_spread
from hilbridge.learning.training.recipes import DEMO_RECIPE, Recipe
from hilbridge.learning.training.replay import Replay, conditions, replay, stream_logits, watch, with_taus
from hilbridge.learning.training.train import Trained, fit_network
from hilbridge.verbs import DEFAULT, Vocabulary
from hilbridge.wearer.timeline import BENCHMARK, DEMO, Difficulty

DIFFICULTIES: Mapping[str, Difficulty] = {"demo": DEMO, "benchmark": BENCHMARK}

SHARES = (0.12, 0.32)  # of people: to stop by, to calibrate on


@dataclass(frozen=True, slots=True)
class TrainConfig:
    """What `train` needs.

    out: the bundle to write. work: checkpoints, logs and recorded streams (an interrupted run goes on from there).
    wearer: "demo" or "benchmark". people of seeds first_seed.., `seconds` each: 12 % to stop training by, 32 % to calibrate
    and choose the threshold on, the rest to train on; nobody is in two groups. Every so many tremble, each in their own way
    (`wearer.shaking.tremor_of`), so that there is a map for each level of tremor. precision: act-only precision tau_on must
    replay to on people that the maps in use were not fitted on.
    """

    out: Path
    work: Path
    wearer: str = "demo"
    people: int = 600
    seconds: float = 60.0
    first_seed: int = 1_000
    trembling_every: int | None = 4
    precision: float = 0.9
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
    stop, fit = (max(1, round(share * config.people)) for share in SHARES)
    groups = (seeds[: -stop - fit], seeds[-stop - fit : -fit], seeds[-fit:])
    with Progress(console=console or Console(stderr=True)) as progress:
        task = progress.add_task("recording simulated wearers", total=config.people)

        def step() -> None:
            progress.advance(task)

        training, stopping, calibrating = (
            record_people(
                group,
                difficulty,
                config.seconds,
                config.work / "streams",
                step,
                trembling_every=config.trembling_every,
            )
            for group in groups
        )
        trained = fit_network(config.recipe, training, stopping, config.work, progress=progress)
    weights = network_weights(trained)
    fitted = calibrate(logits_by_loss(weights, trained.statistics, calibrating), calibrating)
    return save_bundle(make_bundle(trained, fitted, config.precision, _provenance(config, trained)), config.out)


def network_weights(trained: Trained) -> Weights:
    """For the engine that runs. Raises ValueError for a network that it does not."""
    if not isinstance(trained.network, GruNetwork):
        raise ValueError("only the GRU runs in the bridge; the transformer is an ablation")
    return export_weights(trained.network, trained.logit_offset)


def make_bundle(
    trained: Trained,
    fitted: Calibrated,
    precision: float,
    provenance: Provenance,
    vocabulary: Vocabulary = DEFAULT,
) -> Bundle:
    """A network with its calibration; tau_on is the lowest from which on the replay reaches `precision`, or the highest."""
    weights = network_weights(trained)
    assert isinstance(trained.network, GruNetwork)
    statistics = trained.statistics
    made = Bundle(
        weights,
        statistics.mean,
        statistics.std,
        STEPS,
        fitted.temperatures,
        fitted.maps,
        thresholds_at(fitted.curve[-1].tau_on),
        fitted.curve,
        network_vectors(trained.network, trained.logit_offset, statistics.mean, statistics.std, STEPS),
        0.0,
        provenance,
        vocabulary=vocabulary,
        usual=fitted.usual,
    )
    chosen = made.tau_for(precision)
    tau_on = made.thresholds.tau_on if chosen is None else chosen
    return replace(made, thresholds=thresholds_at(tau_on), person_spread=spread_at(fitted, tau_on))


def spread_at(fitted: Calibrated, tau_on: float) -> float:
    """How far people differ at one threshold, from people whose maps were fitted on others."""
    everybody = [
        own
        for turn, done in zip(fitted.turns, replays(fitted.turns, tau_on), strict=True)
        for own in actions_of(done, turn.stream.subject).values()
    ]
    return round(fit_spread(everybody), 4)


def thresholds_at(tau_on: float) -> Thresholds:
    """tau_on with the hysteresis that the curve was replayed with."""
    return Thresholds(tau_on, max(0.02, round(tau_on - TAU_BAND, 3)))


def replay_bundle(bundle: Bundle, people: Stream, tau_on: float | None = None) -> Replay:
    """How a bundle's gate fares on people; at its own threshold unless another is given."""
    logits = stream_logits(bundle.weights, people, Statistics(bundle.mean, bundle.std))
    gate = gate_of(bundle)
    seen = watch(logits, conditions(people), people.subject, bundle.temperatures, gate)
    config = with_taus(gate, bundle.thresholds.tau_on if tau_on is None else tau_on, TAU_BAND)
    return replay(config, seen, people)


def gate_of(bundle: Bundle) -> GateConfig:
    """The gate as a bundle is calibrated for it; thresholds are the caller's to set."""
    return replace(GATE, maps=bundle.maps, vocabulary=bundle.vocabulary)


def versions() -> dict[str, str]:
    """What a bundle is made with."""
    return {"hilbridge": hilbridge.__version__, **{name: version(name) for name in ("torch", "numpy", "scikit-learn")}}


def _provenance(config: TrainConfig, trained: Trained) -> Provenance:
    best = min(trained.history, key=lambda row: row["validation_nll"])
    return Provenance(
        Origin.SIMULATED,
        config.people,
        round(config.people * config.seconds / 60.0, 3),
        {**asdict(config.recipe), "wearer": config.wearer, "first_seed": config.first_seed}
        | {"trembling_every": config.trembling_every},
        figures={"validation": {key: round(float(value), 4) for key, value in best.items()}},
        versions=versions(),
    )
