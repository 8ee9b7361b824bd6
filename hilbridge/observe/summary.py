"""What a run came to, as pure functions of its recorded rows. Definitions are fixed here and nowhere else."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from hilbridge.observe.recording import Row, read_recording


@dataclass(frozen=True, slots=True)
class Latency:
    """Percentiles in ms; None where nothing was measured."""

    p50: float | None
    p99: float | None
    max: float | None


@dataclass(frozen=True, slots=True)
class Summary:
    """Figures of one run.

    seconds: from the first tick to the last. ticks: 25 Hz decisions.
    acts, holds: how often the gate switched to ACT, and to HOLD (the hold it starts in counts as one).
    coverage: share of ticks in ACT. act_only_precision: share of ACT ticks whose verb was the wearer's (paper, E5);
    None without a known truth or without an ACT. false_assists_per_min: ACT episodes that began with a wrong verb.
    hold_reasons: HOLD ticks by named reason. assist_s: time in which the device said its assist was not zero.
    frames_lost: frames that one side sent and the other never had. latency_ms: capture of the picture -> ACT_CMD sent.
    """

    seconds: float
    ticks: int
    acts: int
    holds: int
    act_only_precision: float | None
    coverage: float
    false_assists_per_min: float | None
    hold_reasons: dict[str, int]
    verbs_acted: dict[str, int]
    device_states: dict[str, int]
    assist_s: float
    frames_sent: int
    frames_received: int
    frames_lost: int
    ticks_missed: int
    latency_ms: Latency
    sensors: dict[str, dict[str, Any]] = field(default_factory=dict)
    counters: dict[str, int] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def percentile(values: Sequence[float], share: float) -> float | None:
    """Nearest-rank percentile: a value that was really seen; None of nothing."""
    if not values:
        return None
    ordered = sorted(values)
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)]


def latency_of(values: Sequence[float]) -> Latency:
    return Latency(percentile(values, 0.50), percentile(values, 0.99), max(values) if values else None)


def summarise(rows: Iterable[Row]) -> Summary:
    """Fold the rows of one recording (any order of topics, in order of time within each)."""
    ticks: list[Row] = []
    devices: list[Row] = []
    counters: dict[str, int] = {}
    sensors: dict[str, dict[str, Any]] = {}
    for row in rows:
        if row.topic == "/tick":
            ticks.append(row)
        elif row.topic == "/device":
            devices.append(row)
        elif row.topic == "/counters":
            counters = row.data
        elif row.topic == "/sensors":
            sensors = row.data
    actions = [tick.data["action"] for tick in ticks]
    starts = [now for before, now in zip([None, *ticks], ticks, strict=False) if _action(before) != now.data["action"]]
    act_ticks = [tick.data for tick in ticks if tick.data["action"] == "ACT"]
    judged = [tick for tick in act_ticks if tick.get("right") is not None]
    wrong_starts = [row for row in starts if row.data["action"] == "ACT" and row.data.get("right") is False]
    seconds = (ticks[-1].time_ns - ticks[0].time_ns) / 1e9 if len(ticks) > 1 else 0.0
    knows_truth = any("right" in tick.data for tick in ticks)
    return Summary(
        seconds=seconds,
        ticks=len(ticks),
        acts=sum(row.data["action"] == "ACT" for row in starts),
        holds=sum(row.data["action"] == "HOLD" for row in starts),
        act_only_precision=_share(sum(tick["right"] for tick in judged), len(judged)),
        coverage=_share(actions.count("ACT"), len(actions)) or 0.0,
        false_assists_per_min=len(wrong_starts) / (seconds / 60.0) if knows_truth and seconds else None,
        hold_reasons=dict(
            Counter(tick.data["reason"] for tick in ticks if tick.data["action"] == "HOLD").most_common()
        ),
        verbs_acted=dict(Counter(tick["verb"] for tick in act_ticks).most_common()),
        device_states=dict(Counter(row.data["state"] for row in devices if "state" in row.data).most_common()),
        assist_s=_assist_s(devices),
        frames_sent=counters.get("frames_sent", 0),
        frames_received=counters.get("frames_received", 0),
        frames_lost=counters.get("frames_lost", 0),
        ticks_missed=counters.get("ticks_missed", 0),
        latency_ms=latency_of([t.data["latency_ms"] for t in ticks if t.data.get("latency_ms") is not None]),
        sensors=sensors,
        counters=counters,
    )


def summarise_file(path: Path) -> Summary:
    """The summary of a recording. Raises InputError when the file cannot be read."""
    return summarise(read_recording(path, ("/tick", "/device", "/counters", "/sensors")))


def _action(row: Row | None) -> str | None:
    return row.data["action"] if row is not None else None


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


def _assist_s(devices: list[Row]) -> float:
    """Time between status frames of which the earlier said that assist is not zero."""
    status = [row for row in devices if "assist_zero" in row.data]
    return sum(
        (after.time_ns - before.time_ns) / 1e9
        for before, after in itertools.pairwise(status)
        if not before.data["assist_zero"]
    )
