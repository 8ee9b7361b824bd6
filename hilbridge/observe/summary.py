"""What a run came to, as pure functions of its recorded rows. Definitions are fixed here and nowhere else."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from hilbridge.core.gate_figures import GateTick, gate_figures
from hilbridge.records import Action
from hilbridge.rows import CountersRow, DeviceRow, Row, SensorsRow, SourceAccount, TickRow

# CTRL_STATUS is due every 20 ms and missed after 60.
_BELIEVED_NS = 60_000_000


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
    acts, holds, coverage, act_only_precision, false_assists_per_min: as core.gate_figures defines them; the last two are
    None without a known truth, precision without an ACT, too.
    hold_reasons: HOLD ticks by named reason. assist_s: time in which the device said its assist was not zero.
    missing: what a recording that is not whole lacks.
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
    sensors: dict[str, SourceAccount] = field(default_factory=dict)
    counters: dict[str, int] = field(default_factory=dict)
    missing: str | None = None

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
    ticks: list[TickRow] = []
    devices: list[DeviceRow] = []
    counts: dict[str, int] = {}
    sources: dict[str, SourceAccount] = {}
    end_ns = 0
    for row in rows:
        end_ns = max(end_ns, row.time_ns)
        match row:
            case TickRow():
                ticks.append(row)
            case DeviceRow():
                devices.append(row)
            case CountersRow():
                counts = row.counts
            case SensorsRow():
                sources = row.sources
    gate = gate_figures(GateTick(tick.verb, tick.right) for tick in ticks)
    seconds = (ticks[-1].time_ns - ticks[0].time_ns) / 1e9 if len(ticks) > 1 else 0.0
    knows_truth = any(tick.truth_known for tick in ticks)
    return Summary(
        seconds=seconds,
        ticks=gate.ticks,
        acts=gate.acts,
        holds=gate.holds,
        act_only_precision=gate.act_only_precision,
        coverage=gate.coverage,
        false_assists_per_min=gate.false_assists_per_min(seconds) if knows_truth and seconds else None,
        hold_reasons=_counted(str(tick.reason) for tick in ticks if tick.action is Action.HOLD),
        verbs_acted=_counted(tick.verb for tick in ticks if tick.verb is not None),
        device_states=_counted(row.state for row in devices),
        assist_s=_assist_s(devices, end_ns),
        frames_sent=counts.get("frames_sent", 0),
        frames_received=counts.get("frames_received", 0),
        frames_lost=counts.get("frames_lost", 0),
        ticks_missed=counts.get("ticks_missed", 0),
        latency_ms=latency_of([tick.latency_ms for tick in ticks if tick.latency_ms is not None]),
        sensors=sources,
        counters=counts,
    )


def _counted(words: Iterable[str]) -> dict[str, int]:
    return dict(Counter(words).most_common())


def _assist_s(devices: Sequence[DeviceRow], end_ns: int) -> float:
    """Time between rows of which the earlier says that assist is not zero; a row is believed for 60 ms at most."""
    until_ns = [row.time_ns for row in devices[1:]] + [end_ns]
    spans = zip(devices, until_ns, strict=False)
    return sum(min(next_ns - row.time_ns, _BELIEVED_NS) / 1e9 for row, next_ns in spans if not row.assist_zero)
