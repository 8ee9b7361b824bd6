"""The public way in from Python. What stands here, and in docs/api.md, keeps its meaning within a series of versions;
everything else may move.

Scenarios have theirs in `hilscenario` (`hilscenario.format.files.load_scenario`, `hilscenario.lockstep.run.run_scenario`).
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.config import Config, load_config
from hilbridge.errors import InputError
from hilbridge.features.layout import LAYOUT, D
from hilbridge.intent.bundle import Bundle, load_bundle
from hilbridge.intent.predictor import Predictor
from hilbridge.intent.tremor import TremorGuard
from hilbridge.observe.reading import RecordingReader, read_recording
from hilbridge.records import (
    Action,
    CameraFrame,
    FeatureVector,
    Frame,
    GateDecision,
    GazeSample,
    Hand,
    HandTracks,
    HoldReason,
    IntentEstimate,
    Modality,
)
from hilbridge.runtime.assemble import read_parts
from hilbridge.runtime.deciding import Decider, Told
from hilbridge.sensors.live.base import LiveGaze, RawGaze
from hilbridge.sensors.source import Source
from hilbridge.verbs import VERBS
from hilbridge.wire.codec import Codec

__all__ = [
    "LAYOUT",
    "VERBS",
    "Action",
    "Bundle",
    "BusPort",
    "CameraFrame",
    "Codec",
    "Config",
    "D",
    "FeatureVector",
    "Frame",
    "GateDecision",
    "GazeSample",
    "Hand",
    "HandTracks",
    "HoldReason",
    "InputError",
    "IntentEstimate",
    "LiveGaze",
    "Modality",
    "RawGaze",
    "RecordingReader",
    "Source",
    "Step",
    "Stepper",
    "load_bundle",
    "load_config",
    "read_recording",
]


class Step(NamedTuple):
    """What one tick came to. `verb` is the one that is assisted, None while holding."""

    decision: GateDecision
    estimate: IntentEstimate | None
    verb: str | None


class Stepper:
    """The core of the bridge without sensors, bus and clock: features of your own in, decisions out.

    It is the code that runs live: predictor, calibration, tremor guard, trust that sensing earns, gate.
    """

    def __init__(self, bundle: Path | None = None, config: Config | None = None) -> None:
        """bundle: default, the one that ships. config: thresholds of its own. Raises InputError for what cannot be used."""
        settings = Config() if config is None else config
        if bundle is not None:
            settings = settings.model_copy(update={"model": settings.model.model_copy(update={"bundle": str(bundle)})})
        parts = read_parts(settings)
        self.bundle = parts.bundle
        self._decider = Decider(Predictor(parts.bundle), parts.gate, TremorGuard())

    def step(
        self,
        vector: FeatureVector | None,
        now_ns: int,
        *,
        problem: str | None = None,
        outside: HoldReason = HoldReason.NONE,
    ) -> Step:
        """One 25 Hz tick at `now_ns`. vector: the newest features, None where there are none that are new.

        problem: why a sensor cannot be believed now, in words. outside: another reason to hold, from the device say.
        """
        decision = self._decider.step(Told(vector, problem, outside, False, now_ns))
        verb = self._decider.gate_config.vocabulary.name(decision.verb_index)
        return Step(decision, self._decider.estimate, verb)
