"""What came out differently in a replay, as figures and as spans of time. Pure."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from hilbridge.core.gate_figures import GateTick, gate_figures
from hilbridge.records import Action, GateDecision, IntentEstimate
from hilbridge.replay.settings import Settings
from hilbridge.replay.source import Made, Source
from hilbridge.rows import MetaRow, TickRow

_SHOWN = 12
_JPEG_NOTE = "confidences differ"
HANDS_ANEW, HANDS_RECORDED = "found anew", "as recorded"


@dataclass(frozen=True, slots=True)
class Compared:
    """One tick as recorded, and as decided now."""

    row: TickRow
    decision: GateDecision
    verb: str | None
    estimate: IntentEstimate | None

    @property
    def differs(self) -> bool:
        """Whether another command, verb or reason came out."""
        row, now = self.row, self.decision
        return (row.action, row.verb, row.reason) != (now.action, self.verb, now.reason)

    @property
    def right_now(self) -> bool | None:
        """Whether the verb decided now is the wearer's, where that is known.

        Of another verb than the recorded one only that in preparation is known to be right.
        """
        row = self.row
        if not row.truth_known or self.verb is None:
            return None
        return row.right if self.verb == row.verb else self.verb == row.truth


@dataclass(slots=True)
class Span:
    """Ticks on end that differ in the same way; times in s from the first tick."""

    from_s: float
    until_s: float
    ticks: int
    recorded: str
    now: str


@dataclass(frozen=True, slots=True)
class Figures:
    """The gate's figures of one side; None where nothing acted, or nobody knows."""

    acts: int
    coverage: float
    act_only_precision: float | None


@dataclass(frozen=True, slots=True)
class Difference:
    """What a replay came to. `bit_equal`: every decision, confidence and reason is the recorded one to the last bit."""

    ticks: int
    ticks_differing: int
    bit_equal: bool
    confidence_max: float
    belief_max: float
    spans: tuple[Span, ...]
    spans_in_all: int
    recorded: Figures
    now: Figures
    source: str
    hands: str | None
    bundle: str
    same_bundle: bool
    tau_on: float
    tau_off: float
    what_if: tuple[str, ...]
    made: Made
    lost_rows: int
    missing: str | None
    title: str

    def as_json(self) -> dict[str, Any]:
        """One JSON object."""
        return asdict(self)

    def as_text(self) -> str:
        """For people."""
        start = f"replayed   {self.ticks} ticks from recorded {self.source}"
        if self.hands is not None:
            start += f", hands {self.hands}"
        own = "the recording's own" if self.same_bundle else "not the recording's"
        bundle = "none: beliefs as recorded" if self.source == Source.BELIEFS else f"{self.bundle}, {own}"
        lines = [start, f"bundle     {bundle}"]
        what_if = f" ({', '.join(self.what_if)})" if self.what_if else ""
        lines.append(f"gate       tau_on {self.tau_on:g}, tau_off {self.tau_off:g}{what_if}")
        lines += self._notes()
        if self.bit_equal:
            lines.append("decisions  every one as recorded, confidence and reason to the last bit")
        else:
            lines.append(f"decisions  {self.ticks_differing} of {self.ticks} differ, in {self.spans_in_all} spans")
            lines.append(
                f"confidence differs by {self.confidence_max:.2g} at most, the belief's own by {self.belief_max:.2g}"
            )
        lines += [
            f"  {span.from_s:8.2f} s  {span.ticks:4d} ticks  {span.recorded}  ->  {span.now}" for span in self.spans
        ]
        if self.spans_in_all > len(self.spans):
            lines.append(f"  ... and {self.spans_in_all - len(self.spans)} more")
        lines += [f"{name:<10} {_shown(side)}" for name, side in (("recorded", self.recorded), ("now", self.now))]
        return "\n".join(lines)

    def _notes(self) -> list[str]:
        notes = []
        if self.source == Source.SENSORS:
            notes.append(f"note       {self.made.of_scene} looks anew at the pixels that were seen, unchanged by JPEG")
            if self.made.of_jpeg:
                notes.append(f"note       {self.made.of_jpeg} looks at JPEG, which changes colours: {_JPEG_NOTE}")
            if self.hands == HANDS_ANEW:
                notes.append("note       hands are looked for in JPEG pictures, smaller than they were")
            if self.made.as_recorded:
                notes.append(
                    f"note       {self.made.as_recorded} pictures are not in the recording: features as recorded"
                )
        if self.made.lacking or self.lost_rows:
            notes.append(
                f"note       {self.made.lacking} ticks lack their features, {self.lost_rows} rows were lost in recording: "
                "what follows them cannot be the same"
            )
        if self.missing is not None:
            notes.append(f"not whole  {self.missing}")
        return notes


def _shown(side: Figures) -> str:
    precision = "n/a" if side.act_only_precision is None else f"{side.act_only_precision:.2f}"
    return f"{side.acts} acts, coverage {side.coverage:.3f}, act-only precision {precision}"


@dataclass(slots=True)
class Tally:
    """Counts as ticks come; nothing of them is kept but figures and the first spans."""

    lost_rows: int = 0
    _ticks: int = 0
    _differing: int = 0
    _equal: bool = True
    _confidence_max: float = 0.0
    _belief_max: float = 0.0
    _spans: list[Span] = field(default_factory=list)
    _spans_in_all: int = 0
    _open: Span | None = None
    _from_ns: int = 0
    _sides: tuple[list[GateTick], list[GateTick]] = field(default_factory=lambda: ([], []))

    def add(self, compared: Compared) -> None:
        """The next tick."""
        row, now = compared.row, compared.decision
        if not self._ticks:
            self._from_ns = row.time_ns
        self._ticks += 1
        self._confidence_max = max(self._confidence_max, abs(row.confidence - now.confidence))
        believed = None if compared.estimate is None else compared.estimate.confidence
        if believed is not None and row.top_confidence is not None:
            self._belief_max = max(self._belief_max, abs(believed - row.top_confidence))
        same_belief = believed == row.top_confidence
        self._equal &= not compared.differs and row.confidence == now.confidence and same_belief
        self._differing += compared.differs
        self._note_span(compared)
        self._sides[0].append(GateTick(row.verb, row.right))
        self._sides[1].append(GateTick(compared.verb, compared.right_now))

    def _note_span(self, compared: Compared) -> None:
        if not compared.differs:
            self._open = None
            return
        at_s = (compared.row.time_ns - self._from_ns) / 1e9
        recorded = _words(compared.row.action, compared.row.verb, str(compared.row.reason))
        now = _words(compared.decision.action, compared.verb, str(compared.decision.reason))
        span = self._open
        if span is not None and (span.recorded, span.now) == (recorded, now):
            span.until_s, span.ticks = at_s, span.ticks + 1
            return
        self._open = Span(at_s, at_s, 1, recorded, now)
        self._spans_in_all += 1
        if len(self._spans) < _SHOWN:
            self._spans.append(self._open)

    def result(
        self,
        source: Source,
        settings: Settings,
        made: Made,
        hands: str | None,
        missing: str | None,
        meta: MetaRow,
    ) -> Difference:
        """What it all came to."""
        recorded, now = (gate_figures(side) for side in self._sides)
        return Difference(
            self._ticks,
            self._differing,
            self._equal,
            self._confidence_max,
            self._belief_max,
            tuple(self._spans),
            self._spans_in_all,
            Figures(recorded.acts, recorded.coverage, recorded.act_only_precision),
            Figures(now.acts, now.coverage, now.act_only_precision),
            str(source),
            hands,
            "none" if settings.bundle is None else f"{settings.bundle.bundle_id:#06x}",
            settings.same_bundle,
            settings.gate.tau_on,
            settings.gate.tau_off,
            settings.what_if,
            made,
            self.lost_rows,
            missing,
            meta.title or meta.scenario or "a run of hilbridge",
        )


def _words(action: Action, verb: str | None, reason: str) -> str:
    return f"ACT {verb}" if action is Action.ACT else f"HOLD {reason}"
