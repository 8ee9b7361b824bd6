"""E4 and E5: what a prediction costs, the closed loop through the very gate that runs live, and the loop under tremor."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from hilbridge.confidence import ALL_VALID, MASKS, TREMOR_SHIFT, ConfidenceMaps, RisingMap
from hilbridge.features.layout import D
from hilbridge.intent.bundle import Bundle
from hilbridge.intent.calibration import softmax
from hilbridge.intent.gru import StreamingGru
from hilbridge.learning import metrics
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.synthetic import record_people_with
from hilbridge.learning.data.windows import STEPS, Statistics
from hilbridge.learning.experiments.stream_history import filtered, fit_history
from hilbridge.learning.experiments.tables import MC_PASSES, Pooled, Row
from hilbridge.learning.training.gate_fit import GATE, TAU_BAND, fit_maps
from hilbridge.learning.training.network import GruNetwork, TransformerNetwork, export_weights
from hilbridge.learning.training.replay import (
    Replay,
    Watched,
    conditions,
    replay,
    stream_logits,
    watch,
    window_masks,
    with_taus,
)
from hilbridge.wearer.shaking import realistic
from hilbridge.wearer.timeline import Difficulty

TAUS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
AT_ITS_WORD = ConfidenceMaps({mask: RisingMap((0.0, 1.0), (0.0, 1.0)) for mask in MASKS})
Floats = NDArray[np.float64]
STEPS_PER_MINUTE = 25 * 60


def runtime_table(repeats: int = 200) -> list[Row]:
    """E4: one prediction on one thread, measured here and now: the streaming engine, and torch on one full window as the
    bridge would have to run what the paper rejects on cost (MC dropout, an ensemble) or compares with."""
    torch.set_num_threads(1)
    network, transformer = GruNetwork(dropout=0.0).eval(), TransformerNetwork(dropout=0.0).eval()
    engine = StreamingGru(export_weights(network, np.zeros(21)), STEPS)
    rng = np.random.default_rng(0)
    x = rng.normal(size=(STEPS, D)).astype(np.float32)
    window, usable = torch.from_numpy(x[None]), torch.ones(1, STEPS)
    hidden = network.head.in_features
    factors = rng.normal(size=(network.head.out_features, hidden, hidden)).astype(np.float32)
    steps = iter(range(10**9))

    def laplace() -> None:
        pooled = network.pool(window, usable)[0].numpy()
        network.head(torch.from_numpy(pooled))
        np.square(factors @ pooled).sum(axis=1)

    def dropout_of_head() -> None:
        pooled = network.pool(window, usable)
        for _ in range(MC_PASSES):
            network.head(torch.dropout(pooled, 0.2, True))

    ways: dict[str, Callable[[], object]] = {
        "numpy, one step of all 50 windows (what runs)": lambda: engine.step(x[next(steps) % STEPS], True),
        "torch, one full window": lambda: network(window, usable),
        "last-layer Laplace, one full window": laplace,
        "MC dropout of the head, 10 samples": dropout_of_head,
        "MC dropout of all layers, 10 passes": lambda: [network(window, usable) for _ in range(MC_PASSES)],
        "ensemble of 3": lambda: [network(window, usable) for _ in range(3)],
        "transformer, one full window": lambda: transformer(window, usable),
    }
    rows: list[Row] = []
    with torch.inference_mode():
        for name, way in ways.items():
            took = _timed(way, repeats)
            rows.append({"what": name, "p50_ms": float(np.median(took)), "p99_ms": float(np.quantile(took, 0.99))})
    for row in rows:
        row["times_what_runs"] = row["p50_ms"] / rows[0]["p50_ms"]
    return [*rows, {"what": "the paper: one full window on a CPU, 2 to 3 ms", "p50_ms": 2.5}]


def _timed(way: Callable[[], object], repeats: int) -> list[float]:
    """Milliseconds of each call, the first tenth (warming up) left out."""
    took = []
    for _ in range(repeats + repeats // 10):
        start = time.perf_counter()
        way()
        took.append((time.perf_counter() - start) * 1e3)
    return took[repeats // 10 :]


def _fold_stream(fold: Any, prefix: str = "stream") -> Stream:
    return Stream(**{name: fold[f"{prefix}_{name}"] for name in Stream.__dataclass_fields__})


def _watched(logits: Floats, stream: Stream, temperature: float) -> Watched:
    """A stream as the gate sees it, all modalities there."""
    return watch(logits, np.full(len(stream), ALL_VALID), stream.subject, {ALL_VALID: temperature}, GATE)


def closed_loop_table(pooled: Pooled) -> list[Row]:
    """E5: tau sweep over streams of unseen people; right is what `core.right` says.

    none: the smoothed probability at its word. gate: as shipped, calibrated on what the gate compares, on other people.
    """
    loops = []
    for fold, calibration in zip(pooled.folds, pooled.calibrations, strict=True):
        temperature = calibration.temperature(ALL_VALID)
        fitted_on = _fold_stream(fold, "validation_stream")
        maps = fit_maps([(_watched(fold["validation_stream_logits"], fitted_on, temperature), fitted_on)])
        stream = _fold_stream(fold)
        loops.append(
            (stream, _watched(fold["stream_logits"], stream, temperature), {"none": AT_ITS_WORD, "gate": maps})
        )
    rows = []
    for method in ("none", "gate"):
        for tau in TAUS:
            done = [
                (stream, replay(with_taus(replace(GATE, maps=maps[method]), tau, TAU_BAND), seen, stream))
                for stream, seen, maps in loops
            ]
            rows.append({"method": method, "tau_on": tau, **_summary(done)})
    return rows


def history_loop_table(pooled: Pooled) -> list[Row]:
    """The same streams and gate when the believed history is fused in at every step, with maps of its own."""
    done: list[tuple[Stream, Watched, ConfidenceMaps, Row]] = []
    for fold, calibration in zip(pooled.folds, pooled.calibrations, strict=True):
        temperature = calibration.temperature(ALL_VALID)
        others = _fold_stream(fold, "validation_stream")
        fitted = fit_history(fold["validation_stream_logits"], others, temperature)
        before = filtered(fold["validation_stream_logits"], others, temperature, fitted.trust, fitted.hazard)
        maps = fit_maps([(_watched(_log(before), others, 1.0), others)])
        stream, logits = _fold_stream(fold), fold["stream_logits"]
        belief = filtered(logits, stream, temperature, fitted.trust, fitted.hazard)
        judged = np.flatnonzero(~np.isnan(logits[:, 0]) & (stream.event >= 0))
        labels = stream.label[judged]
        figures: Row = {
            "nll_sensors": metrics.nll(softmax(logits[judged] / temperature), labels),
            "nll_with_history": metrics.nll(belief[judged], labels),
            "trust": fitted.trust,
            "hazard_per_step": fitted.hazard,
        }
        done.append((stream, _watched(_log(belief), stream, 1.0), maps, figures))
    rows = []
    for tau in TAUS:
        replayed = [
            (stream, replay(with_taus(replace(GATE, maps=maps), tau, TAU_BAND), seen, stream))
            for stream, seen, maps, _ in done
        ]
        means = {name: float(np.mean([figures[name] for *_, figures in done])) for name in done[0][3]}
        rows.append({"method": "history, gate", "tau_on": tau, **_summary(replayed), **means})
    return rows


def _log(belief: Floats) -> Floats:
    return np.log(np.maximum(belief, 1e-12))


def _summary(done: Sequence[tuple[Stream, Replay]]) -> Row:
    acting = np.concatenate([result.acting for _, result in done])
    right = np.concatenate([result.right for _, result in done])
    onset = np.concatenate([stream.onset_steps for stream, _ in done])
    confidence = np.concatenate([result.confidence for _, result in done])
    row: Row = {
        "coverage": float(acting.mean()),
        "act_only_precision": float(right[acting].mean()) if acting.any() else None,
        "mean_confidence_while_acting": float(confidence[acting].mean()) if acting.any() else None,
        "false_assists_per_minute": sum(result.false_assists for _, result in done) / (len(acting) / STEPS_PER_MINUTE),
    }
    for low, high in ((0.0, 0.5), (0.5, 1.0), (1.0, 2.0)):
        near = acting & (onset >= low * 25) & (onset < high * 25)
        row[f"aop_{low:g}_to_{high:g}_s_before_onset"] = float(right[near].mean()) if near.any() else None
    return row


def tremor_table(
    bundle: Bundle,
    difficulty: Difficulty,
    seeds: Iterable[int],
    seconds: float,
    frequencies: Sequence[float] = (3.0, 5.0, 8.0),
) -> list[Row]:
    """The gate on people who tremble (wandering amplitude and frequency, head, gaze, lost hands, overshoot).

    off: every step judged by the map of calm people; on: by the map of the level of tremor that the guard sees, as shipped.
    """
    config = with_taus(replace(GATE, maps=bundle.maps), bundle.thresholds.tau_on, TAU_BAND)
    rows = []
    people = list(seeds)
    for hz in (None, *frequencies):
        stream = record_people_with(people, difficulty, seconds, None if hz is None else realistic(hz))
        logits = stream_logits(bundle.weights, stream, Statistics(bundle.mean, bundle.std))
        for name, under in (("off", window_masks(stream)), ("on", conditions(stream))):
            seen = watch(logits, under, stream.subject, bundle.temperatures, GATE)
            result = replay(config, seen, stream)
            acts = bool(result.acting.any())
            rows.append(
                {
                    "tremor_hz": hz or 0.0,
                    "guard": name,
                    "trembling": float((under >> TREMOR_SHIFT > 0).mean()),
                    "coverage": result.coverage,
                    "act_only_precision": result.act_only_precision if acts else None,
                    "claimed": result.mean_confidence if acts else None,
                    "tau_on": config.tau_on,
                }
            )
    return rows
