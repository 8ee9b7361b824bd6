"""E1 to E5 on recorded people, everybody judged by a network and by maps that never met them; by person, with intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hilbridge.confidence import ALL_VALID
from hilbridge.intent.bundle import Bundle
from hilbridge.learning import metrics
from hilbridge.learning.calibrators import Method
from hilbridge.learning.data.people import People
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.windows import window_ends
from hilbridge.learning.experiments.closed_loop import runtime_table
from hilbridge.learning.experiments.report import Row, Section, curve_figure, reliability_figure
from hilbridge.learning.training.fit import fit_calibration
from hilbridge.learning.training.folds import LEAD_STEPS, Folded
from hilbridge.learning.training.gate_fit import Calibrated, Turn, replays
from hilbridge.learning.training.replay import Replay, mapped
from hilbridge.records import Modality

Floats = NDArray[np.float64]
REPORTED = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
LEAST_ACTING = 250  # ticks, ten seconds: less says nothing about a precision


@dataclass(frozen=True, slots=True)
class Windows:
    """Windows 0.52 s before onsets with out-of-fold logits; confidence by calibrator, fitted on the other people."""

    logits: Floats
    labels: NDArray[np.int64]
    subject: NDArray[np.int64]
    confidence: Mapping[Method, Floats]

    @property
    def right(self) -> NDArray[np.bool_]:
        """Whether the top class is the label."""
        return np.asarray(self.logits.argmax(axis=1) == self.labels)


def onset_windows(stream: Stream, logits: Floats, folds: int = 5) -> Windows:
    """The paper's windows, calibrated on other people."""
    ends = window_ends(stream)
    ends = ends[stream.known[ends] & (stream.onset_steps[ends] == LEAD_STEPS) & ~np.isnan(logits[ends, 0])]
    own, labels, subject = logits[ends], stream.label[ends], stream.subject[ends]
    confidence = {method: np.zeros(len(ends)) for method in Method}
    people = np.unique(subject)
    for start in range(min(folds, len(people))):
        inside = np.isin(subject, people[start::folds])
        if inside.all():
            continue
        fitted = fit_calibration({ALL_VALID: (own[~inside], labels[~inside])}, Method.ISOTONIC)
        for method in Method:
            confidence[method][inside] = replace(fitted, method=method).confidence(own[inside], ALL_VALID)
    return Windows(own, labels, subject, confidence)


def people_sections(people: People, folded: Folded, fitted: Calibrated, bundle: Bundle) -> list[Section]:
    """Every section that these people allow."""
    windows = onset_windows(people.stream, folded.logits[0])
    sections = [_people(people)]
    if len(windows.labels) >= 10 and len(np.unique(windows.subject)) > 1:
        sections += [_calibration(windows), _losses(people, folded), _selective(windows)]
    origin = "real" if people.origin == "recorded people" else "synthetic"
    sections += [
        Section(
            "e4_runtime", "E4: runtime", origin, runtime_table(40), "Untrained weights of the full size, this machine."
        ),
        _loop(fitted.turns),
        _by_person(people, fitted.turns, bundle.thresholds.tau_on),
    ]
    return [replace(section, origin=origin) for section in sections]


def _people(people: People) -> Section:
    rows = [
        {
            "session": session.name,
            "person": session.person,
            "labelled_minutes": session.known_minutes,
            **{
                f"valid_{modality.name.lower()}": float(session.stream.valid[:, int(modality)].mean())
                for modality in Modality
            },
            "actions": len(np.unique(session.stream.event[session.stream.event >= 0])),
        }
        for session in people.sessions
    ]
    return Section("people", f"{len(people.names)} people, {people.minutes:.1f} labelled minutes", "real", rows)


def _share(hits: NDArray[np.bool_], index: NDArray[np.int64]) -> float:
    return float(hits[index].mean())


def _calibration(windows: Windows) -> Section:
    rows, right = [], windows.right
    for method, confidence in windows.confidence.items():
        low, high = metrics.bootstrap(partial(_share, right), windows.subject, 400)
        rows.append(
            {
                "method": str(method),
                "windows": len(right),
                "top1": float(right.mean()),
                "top1_low": low,
                "top1_high": high,
                "ece15": metrics.ece(confidence, right),
                "noise_floor": metrics.noise_floor(confidence),
                "aurc": metrics.aurc(confidence, right),
            }
        )
    most = float(np.bincount(windows.labels).max() / len(windows.labels))
    diagram = reliability_figure({str(method): (own, windows.right) for method, own in windows.confidence.items()})
    note = f"2 s windows ending 0.52 s before onset; the most frequent verb alone has Top-1 {most:.3f}."
    return Section("e1_calibration", "E1: calibration of windows", "real", rows, note, diagram)


def _losses(people: People, folded: Folded) -> Section:
    rows: list[Row] = []
    for lost, logits in zip(folded.losses, folded.logits, strict=True):
        windows = onset_windows(people.stream, logits)
        if not len(windows.labels):
            continue
        rows.append(
            {
                "lost": ", ".join(modality.name.lower() for modality in lost) or "nothing",
                "windows": len(windows.labels),
                "top1": float(windows.right.mean()),
                "ece15_isotonic": metrics.ece(windows.confidence[Method.ISOTONIC], windows.right),
            }
        )
    return Section("e2_losses", "E2: modalities lost", "real", rows)


def _selective(windows: Windows) -> Section:
    confidence = windows.confidence[Method.ISOTONIC] + 1e-6 * windows.confidence[Method.TEMPERATURE]
    right = windows.right
    rows = []
    for coverage in (1.0, 0.75, 0.5, 0.25, 0.1):

        def precision(index: NDArray[np.int64], share: float = coverage) -> float:
            return metrics.precision_at_coverage(confidence[index], right[index], share)

        low, high = metrics.bootstrap(precision, windows.subject, 200)
        rows.append(
            {"coverage": coverage, "act_only_precision": precision(np.arange(len(right))), "low": low, "high": high}
        )
    return Section("e3_selective", "E3: act-only precision against coverage of windows", "real", rows, "By person.")


def _loop(turns: Sequence[Turn]) -> Section:
    rows = [loop_row(turns, tau_on) for tau_on in REPORTED]
    line = {"reached": ([row["tau_on"] for row in rows], [row["act_only_precision"] for row in rows])}
    note = (
        "Every step of every labelled session through the gate; maps fitted on other people; intervals by person. claimed: "
        "mean confidence while acting. Rows with few acting ticks say little."
    )
    figure = curve_figure(line, "tau_on", "act-only precision", {})
    return Section("e5_closed_loop", "E5: closed loop", "real", rows, note, figure)


def loop_row(turns: Sequence[Turn], tau_on: float) -> dict[str, Any]:
    """What the gate claims and reaches at one threshold."""
    done = replays(turns, tau_on)
    judged = [one.judged for one in done]
    right = np.concatenate([one.right[at] for one, at in zip(done, judged, strict=True)]).astype(float)
    claimed = np.concatenate([one.confidence[at] for one, at in zip(done, judged, strict=True)])
    subject = np.concatenate([turn.stream.subject[at] for turn, at in zip(turns, judged, strict=True)])
    known = sum(int(turn.stream.known.sum()) for turn in turns)
    row: dict[str, Any] = {"tau_on": tau_on, "coverage": len(right) / max(1, known), "acting_ticks": len(right)}
    if not len(right):
        return {**row, "act_only_precision": None}
    low, high = metrics.bootstrap(lambda index: float(right[index].mean()), subject, 400)
    return {
        **row,
        "people_acting": len(np.unique(subject)),
        "act_only_precision": float(right.mean()),
        "low": low,
        "high": high,
        "claimed": float(claimed.mean()),
        "claimed_less_reached": float(claimed.mean() - right.mean()),
        "false_assists_per_minute": sum(one.false_assists for one in done) / max(1e-9, known / 25.0 / 60.0),
        "ece_of_ticks": tick_ece(turns),
    }


def tick_ece(turns: Sequence[Turn]) -> float:
    """ECE15 over every tick at which the gate could act."""
    confidence, right = [], []
    for turn in turns:
        used = turn.seen.able & turn.stream.known
        confidence.append(mapped(turn.gate.maps, turn.seen.probability, turn.seen.condition)[used])
        right.append(turn.stream.right(turn.seen.candidate)[used])
    return metrics.ece(np.concatenate(confidence), np.concatenate(right))


def _by_person(people: People, turns: Sequence[Turn], tau_on: float) -> Section:
    rows = []
    for turn, done in zip(turns, replays(turns, tau_on), strict=True):
        rows += [_person(people.names[number], turn, done, turn.stream.subject == number) for number in _numbers(turn)]
    note = f"At the bundle's tau_on {tau_on:g}. Under {LEAST_ACTING} acting ticks a precision is left out."
    return Section("by_person", "By person", "real", sorted(rows, key=lambda row: str(row["person"])), note)


def _numbers(turn: Turn) -> list[int]:
    return [int(number) for number in np.unique(turn.stream.subject)]


def _person(name: str, turn: Turn, done: Replay, where: NDArray[np.bool_]) -> dict[str, Any]:
    acting = done.judged & where
    count = int(acting.sum())
    enough = count >= LEAST_ACTING
    return {
        "person": name,
        "coverage": count / max(1, int((turn.stream.known & where).sum())),
        "acting_ticks": count,
        "act_only_precision": float(done.right[acting].mean()) if enough else None,
        "claimed": float(done.confidence[acting].mean()) if enough else None,
    }
