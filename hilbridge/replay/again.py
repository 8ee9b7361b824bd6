"""A recording decided anew, tick by tick, by the code that runs live; and where it comes out differently."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from hilbridge.core.bridge import Command
from hilbridge.errors import InputError
from hilbridge.intent.predictor import Predictor
from hilbridge.intent.tremor import TremorGuard
from hilbridge.observe.reading import RecordingReader, read_recording
from hilbridge.records import Action, FeatureVector, HoldReason, IntentEstimate
from hilbridge.replay.difference import HANDS_ANEW, HANDS_RECORDED, Compared, Difference, Tally
from hilbridge.replay.settings import Settings, settings_for
from hilbridge.replay.source import (
    TOPICS,
    AnewLooks,
    Eyes,
    FindsHands,
    Made,
    RecordedLooks,
    RecordedTick,
    Source,
    recorded_ticks,
)
from hilbridge.rows import BeliefRow, BundleRow, ConfigRow, CountersRow, HandsRow, MetaRow, Row, TickRow, estimate_of
from hilbridge.runtime.deciding import Decider, Predicts, Told, decided

_FIRST_ROWS = (MetaRow.topic, ConfigRow.topic, BundleRow.topic)
_AT_REST = Command(Action.HOLD, "None", HoldReason.NO_ESTIMATE, 0)


@dataclass(frozen=True, slots=True)
class Options:
    """source: None is from features, or from beliefs where no bundle made them. what_if: `gate.tau_on=0.7`."""

    source: Source | None = None
    bundle: Path | None = None
    what_if: tuple[str, ...] = ()


class RecordedBeliefs:
    """Believes what was believed; told before each tick."""

    def __init__(self) -> None:
        self.belief: BeliefRow | None = None

    def step(self, vector: FeatureVector, produced_ns: int) -> IntentEstimate | None:
        """The belief of this tick."""
        return None if self.belief is None else estimate_of(self.belief)

    def reset(self) -> None: ...


def replay(
    places: Path | Sequence[Path], options: Options, watch: Callable[[Compared], None] = lambda compared: None
) -> Difference:
    """Decide a recording anew and compare. `watch` sees every tick. Raises InputError."""
    meta, config, recorded = _first_rows(places)
    source = options.source or (
        Source.BELIEFS if recorded is not None and recorded.intent != "predictor" else Source.FEATURES
    )
    reader = read_recording(places, (*TOPICS[source], TickRow.topic, CountersRow.topic))
    settings = settings_for(str(reader.path), config, recorded, options.bundle, options.what_if)
    made, tally = Made(), Tally()
    with ExitStack() as held:
        looks, hands = RecordedLooks(), None
        ticks: Iterator[RecordedTick]
        if source is Source.SENSORS:
            detector = _detector(places, held)
            hands = HANDS_RECORDED if detector is None else HANDS_ANEW
            ticks = recorded_ticks(_counted(reader, tally), _anew(made, detector), made)
        else:
            ticks = recorded_ticks(_counted(reader, tally), looks, made)
        for compared in _decide(reader, ticks, settings, source):
            tally.add(compared)
            watch(compared)
    return tally.result(source, settings, replace(made), hands, reader.missing, meta)


def _first_rows(places: Path | Sequence[Path]) -> tuple[MetaRow, ConfigRow | None, BundleRow | None]:
    found: dict[str, Row] = {}
    for row in read_recording(places, _FIRST_ROWS):
        found.setdefault(row.topic, row)
        if len(found) == len(_FIRST_ROWS):
            break
    meta, config, bundle = (found.get(topic) for topic in _FIRST_ROWS)
    return (
        meta if isinstance(meta, MetaRow) else MetaRow(0),
        config if isinstance(config, ConfigRow) else None,
        bundle if isinstance(bundle, BundleRow) else None,
    )


def _counted(rows: Iterable[Row], tally: Tally) -> Iterator[Row]:
    """The rows, less those that only say what was lost."""
    for row in rows:
        if isinstance(row, CountersRow):
            tally.lost_rows = max(tally.lost_rows, row.counts.get("recording.lost_rows", 0))
        else:
            yield row


def _anew(made: Made, detector: FindsHands | None) -> AnewLooks:
    from hilbridge.observe.keeping.pictures import camera_frame, scene_frame

    return AnewLooks(made, Eyes(scene_frame, camera_frame, detector))


def _detector(places: Path | Sequence[Path], held: ExitStack) -> FindsHands | None:
    """The detector where it found the recorded hands, and is here; None: hands as they were recorded."""
    first = next(
        (row for row in read_recording(places, (HandsRow.topic,)) if isinstance(row, HandsRow) and row.hands), None
    )
    if first is None or not first.hands[0].landmarks:
        return None
    from hilbridge.sensors.hands import HandDetector
    from hilbridge.sensors.models import hand_model_path

    try:
        return held.enter_context(HandDetector(hand_model_path()))
    except InputError:
        return None


def _decide(
    reader: RecordingReader, ticks: Iterator[RecordedTick], settings: Settings, source: Source
) -> Iterator[Compared]:
    decider: Decider | None = None
    before, beliefs, verbs = _AT_REST, RecordedBeliefs(), settings.gate.vocabulary
    for tick in ticks:
        if tick.row.first:
            decider, before = Decider(_predictor(settings, source, beliefs), settings.gate, TremorGuard()), _AT_REST
        if decider is None:
            raise InputError(
                f"recording {reader.path}: begins in the middle of a run; name the run's folder, or its parts from the first"
            )
        beliefs.belief = tick.belief
        row = tick.row
        told = Told(tick.vector, row.sensor_problem, row.outside, row.overrun, row.time_ns, row.felt_tremor)
        decision, before = decided(decider, told, before)
        yield Compared(row, decision, verbs.name(decision.verb_index), decider.estimate)


def _predictor(settings: Settings, source: Source, beliefs: RecordedBeliefs) -> Predicts:
    if source is Source.BELIEFS or settings.bundle is None:
        return beliefs
    return Predictor(settings.bundle)
