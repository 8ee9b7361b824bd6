"""E4 and E5: what a prediction costs, the closed loop through the very gate that runs live, and the loop under tremor."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from hilbridge.core.gate import GateConfig
from hilbridge.features.layout import D
from hilbridge.intent.bundle import Bundle
from hilbridge.intent.calibration import ALL_VALID, Calibration, Method
from hilbridge.intent.gru import StreamingGru
from hilbridge.intent.tremor import TremorGuard
from hilbridge.learning.network import GruNetwork, export_weights
from hilbridge.learning.replay import Replay, estimates, replay, stream_logits
from hilbridge.learning.synthetic import Stream, record_people_with
from hilbridge.learning.tables import Pooled, Row
from hilbridge.learning.windows import STEPS, Statistics
from hilbridge.records import FeatureVector
from hilbridge.wearer.person import Tremor
from hilbridge.wearer.timeline import Difficulty

TAUS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
STEPS_PER_MINUTE = 25 * 60


def runtime_table(repeats: int = 300) -> list[Row]:
    """E4: one prediction step in numpy against torch's full window, both measured here and now on one thread."""
    torch.set_num_threads(1)
    network = GruNetwork(dropout=0.0).eval()
    engine = StreamingGru(export_weights(network, np.zeros(21)), STEPS)
    x = np.random.default_rng(0).normal(size=(STEPS, D)).astype(np.float32)
    window, usable = torch.from_numpy(x[None]), torch.ones(1, STEPS)
    streaming, full = [], []
    with torch.inference_mode():
        for index in range(repeats + STEPS):
            start = time.perf_counter()
            engine.step(x[index % STEPS], True)
            streaming.append(time.perf_counter() - start)
        for _ in range(repeats):
            start = time.perf_counter()
            network(window, usable)
            full.append(time.perf_counter() - start)
    ours, theirs = float(np.median(streaming[STEPS:])) * 1e3, float(np.median(full)) * 1e3
    return [
        {
            "what": "numpy, one step of all 50 windows",
            "p50_ms": ours,
            "p99_ms": float(np.quantile(streaming, 0.99)) * 1e3,
        },
        {"what": "torch, one full window", "p50_ms": theirs, "p99_ms": float(np.quantile(full, 0.99)) * 1e3},
        {"what": "ratio", "p50_ms": ours / theirs},
        {"what": "the paper, one full window on a CPU", "p50_ms": 2.5},
    ]


def _fold_stream(fold: Any) -> Stream:
    return Stream(**{name: fold[f"stream_{name}"] for name in Stream.__dataclass_fields__})


def closed_loop_table(pooled: Pooled) -> list[Row]:
    """E5: tau sweep over streams of unseen people, calibrated and not; right is what the wearer is preparing or doing."""
    rows = []
    for method in (Method.NONE, Method.ISOTONIC):
        loops = []
        for fold, calibration in zip(pooled.folds, pooled.calibrations, strict=True):
            chosen = Calibration(
                method, calibration.temperatures, calibration.platt, calibration.isotonic_x, calibration.isotonic_y
            )
            loops.append((_fold_stream(fold), estimates(fold["stream_logits"], chosen, ALL_VALID)))
        for tau in TAUS:
            config = GateConfig(tau_on=tau, tau_off=tau - 0.1)
            done = [(stream, replay(config, beliefs, stream)) for stream, beliefs in loops]
            rows.append({"method": str(method), "tau_on": tau, **_summary(done)})
    return rows


def _summary(done: Sequence[tuple[Stream, Replay]]) -> Row:
    acting = np.concatenate([result.acting for _, result in done])
    right = np.concatenate([result.right for _, result in done])
    onset = np.concatenate([stream.onset_steps for stream, _ in done])
    row: Row = {
        "coverage": float(acting.mean()),
        "act_only_precision": float(right[acting].mean()) if acting.any() else None,
        "false_assists_per_minute": sum(result.false_assists for _, result in done) / (len(acting) / STEPS_PER_MINUTE),
    }
    for low, high in ((0.0, 0.5), (0.5, 1.0), (1.0, 2.0)):
        near = acting & (onset >= low * 25) & (onset < high * 25)
        row[f"aop_{low:g}_to_{high:g}_s_before_onset"] = float(right[near].mean()) if near.any() else None
    return row


def guard_flags(stream: Stream) -> NDArray[np.bool_]:
    """The tremor guard's judgement at each step of a stream."""
    flags = np.zeros(len(stream), dtype=bool)
    guard = TremorGuard()
    for index in range(len(stream)):
        if index and stream.subject[index] != stream.subject[index - 1]:
            guard.reset()
        valid = (bool(stream.valid[index, 0]), bool(stream.valid[index, 1]), bool(stream.valid[index, 2]))
        flags[index] = guard.update(FeatureVector(0, 0, stream.values[index], valid))
    return flags


def tremor_table(
    bundle: Bundle,
    difficulty: Difficulty,
    seeds: Iterable[int],
    seconds: float,
    frequencies: Sequence[float] = (4.0, 6.0, 8.0),
) -> list[Row]:
    """Act-only precision among acts with tremor of 0.02 picture widths, without and with the guard (which holds)."""
    config = GateConfig(tau_on=bundle.thresholds.tau_on, tau_off=bundle.thresholds.tau_off)
    rows = []
    people = list(seeds)
    for hz in (None, *frequencies):
        stream = record_people_with(people, difficulty, seconds, None if hz is None else Tremor(hz))
        logits = stream_logits(bundle.weights, stream, Statistics(bundle.mean, bundle.std))
        beliefs = estimates(logits, bundle.calibration, ALL_VALID)
        flags = guard_flags(stream)
        guarded = [None if flag else belief for flag, belief in zip(flags, beliefs, strict=True)]
        for name, given in (("off", beliefs), ("on", guarded)):
            result = replay(config, given, stream)
            acts = bool(result.acting.any())
            rows.append(
                {
                    "tremor_hz": hz or 0.0,
                    "guard": name,
                    "held_by_guard": float(flags.mean()) if name == "on" else None,
                    "coverage": result.coverage,
                    "act_only_precision": result.act_only_precision if acts else None,
                    "tau_on": config.tau_on,
                }
            )
    return rows
