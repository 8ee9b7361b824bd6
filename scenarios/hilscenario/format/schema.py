"""The scenario format: flat YAML, strict, read into one frozen object that the Python builder makes as well.

Unknown keys are refused with file and line, and every error offers the nearest valid name.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, field_validator, model_validator
from pydantic_core import PydanticCustomError

from hilbridge.errors import nearest
from hilbridge.verbs import VERBS
from hilscenario.format.durations import Duration
from hilscenario.format.vocabulary import SENSORS, checked_options, fault_kind
from hilscenario.signals.check import formula_problem
from hilscenario.signals.domains import OF_THE_MIND, domains_of
from hilscenario.signals.stl import signal_names

HAZARDS = tuple(f"H{number}" for number in range(1, 10))


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class WearerPart(_Part):
    """The simulated person. `difficulty` is how clear the preparations of actions are."""

    difficulty: Literal["demo", "benchmark"] = "demo"
    seed: int | None = Field(None, ge=0, description="default: the scenario's seed")


class BusPart(_Part):
    """The simulated bus."""

    bitrate: Literal[125_000, 250_000, 500_000, 1_000_000] = 500_000
    bit_error_rate: Annotated[float, Field(ge=0.0, le=1e-3)] = 0.0


class DevicePart(_Part):
    """The simulated device."""

    clock_ppm: Annotated[float, Field(ge=-500.0, le=500.0)] = 40.0
    arm: Literal["still", "reach", "sway"] = "sway"  # what the wearer's elbow does meanwhile
    reset_command: str | None = None  # resets a device under test (`--device external`)


class GatePart(_Part):
    """The gate's operating point; what is left out comes from the bundle."""

    tau_on: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    tau_off: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None
    refractory: Duration = 240_000_000  # ns, as every parsed duration
    alpha: Annotated[float, Field(gt=0.0, le=1.0)] = 0.2

    @model_validator(mode="after")
    def _band(self) -> GatePart:
        if self.tau_on is not None and self.tau_off is not None and self.tau_off >= self.tau_on:
            raise ValueError(f"tau_off = {self.tau_off:g} must be below tau_on = {self.tau_on:g}")
        return self


class Estimate(_Part):
    """From `at` on, a scripted predictor believes in `verb` with `confidence`."""

    at: Duration
    verb: str
    confidence: Annotated[float, Field(ge=0.0, le=1.0)]

    @field_validator("verb")
    @classmethod
    def _known(cls, verb: str) -> str:
        if verb not in VERBS:
            raise ValueError(f"unknown verb `{verb}`; {nearest(verb, VERBS)}")
        return verb


class Session(_Part):
    """A recorded session as the source of intent: a feature pack, an earlier run, video and gaze, or an iAssistADL folder.

    Files are looked for beside the scenario's own file.
    """

    features: str | None = Field(None, description="feature pack (.npz) of `hilbridge data pack`")
    recording: str | None = Field(None, description="MCAP recording of an earlier run; goes with `replay`")
    replay: Literal["beliefs", "features", "sensors"] = Field(
        "beliefs", description="what of the recording: its beliefs, its features, or its pictures, gaze and hands"
    )
    folder: str | None = Field(None, description="recording folder of the iAssistADL group: gaze, wrists, acceleration")
    projection: tuple[float, ...] | None = Field(
        None, description="twelve numbers that carry the folder's skeleton into the picture; left out: no hands"
    )
    video: str | None = Field(None, description="what the head camera saw; goes with `gaze`, and may go with `folder`")
    gaze: str | None = Field(None, description="Neon folder, BeGaze .txt or .csv; goes with `video`")
    hands: bool = Field(False, description="find hands in the video (extra `hands`)")
    from_: Annotated[Duration, Field(alias="from", description="where in the session the scenario begins")] = 0

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    @model_validator(mode="after")
    def _one_source(self) -> Session:
        given = [name for name in ("features", "recording", "gaze", "folder") if getattr(self, name) is not None]
        if len(given) > 1 or not (given or self.video):
            named = " and ".join(given) or "none"
            raise ValueError(f"a session has one of features, recording, video with gaze, folder; this has {named}")
        if (self.video is None) != (self.gaze is None) and (self.folder is None or self.gaze is not None):
            raise ValueError("`video` and `gaze` go together, or `video` with a `folder`")
        if self.projection is not None and self.folder is None:
            raise ValueError("`projection` is of the skeleton in a `folder`")
        if self.replay != "beliefs" and self.recording is None:
            raise ValueError("`replay` says what of a `recording`")
        if self.hands and self.gaze is None:
            raise ValueError("`hands` are looked for in a `video` that goes with `gaze`")
        return self

    @property
    def replays_beliefs(self) -> bool:
        """Whether a predictor of an earlier run believes here, whatever is seen."""
        return self.recording is not None and self.replay == "beliefs"

    @property
    def unchangeable(self) -> tuple[str, ...]:
        """Faults that would have to change what has been recorded already: names, or their beginnings and ends."""
        if self.replays_beliefs:
            return ()
        if self.features is not None or self.replay == "features":
            kinds = ("stuck", "garbage", "wrong", "drift")
            sensors = tuple(f"{sensor}.{kind}" for sensor in SENSORS for kind in kinds)
            wearer = ("tremor", "ataxia", "blink", "look_away", "hands_out_of_view")
            return (*sensors, *(f"wearer.{kind}" for kind in wearer))
        if self.folder is not None and self.video is None:
            return ("wearer.tremor", "camera.stuck", "camera.garbage", "camera.wrong", "camera.drift")
        return ("wearer.tremor",)


def _kind_of_intent(given: Any) -> str:
    """Which member of the union is meant, so that errors speak of that one. Brackets: see `_location`."""
    if isinstance(given, dict | Session):
        return "[session]"
    return "[script]" if isinstance(given, list | tuple) else "[word]"


Intent = Annotated[
    Annotated[Literal["predictor"], Tag("[word]")]
    | Annotated[tuple[Estimate, ...], Tag("[script]")]
    | Annotated[Session, Tag("[session]")],
    Discriminator(_kind_of_intent),
]


class Step(_Part):
    """One fault and when it is injected: `at` a time, `every` so often from `at` on, or `when` a condition first holds."""

    fault: str
    at: Duration | None = None
    every: Duration | None = None
    when: str | None = Field(None, description="a condition on signals, such as device.state == Assist")
    after: Duration = Field(0, description="so long after `when` first holds")
    for_: Annotated[Duration | None, Field(alias="for", description="how long; default: to the end")] = None
    options: dict[str, float] = Field(default_factory=dict, alias="with")

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    @model_validator(mode="after")
    def _consistent(self) -> Step:
        kind = fault_kind(self.fault)
        object.__setattr__(self, "options", checked_options(self.fault, self.options))
        if (self.at is None) == (self.when is None):
            raise ValueError("a step needs either `at` or `when`")
        if self.when is not None and self.every is not None:
            raise ValueError("`every` goes with `at`, not with `when`")
        if self.every is not None and self.for_ is None and not kind.instant:
            raise ValueError("a step with `every` needs `for`: how long each time")
        if self.every is not None and self.for_ is not None and self.for_ >= self.every:
            raise ValueError("`for` must be shorter than `every`")
        if kind.instant and self.for_ is not None:
            raise ValueError(f"`{self.fault}` happens at an instant; leave `for` out")
        return self


class Expectation(_Part):
    """What must hold: a formula (`that`), or a figure of the run within limits (`figure`, `at_least`, `at_most`)."""

    that: str | None = None
    figure: str | None = None
    at_least: float | None = None
    at_most: float | None = None
    name: str = ""

    @model_validator(mode="after")
    def _one_kind(self) -> Expectation:
        if (self.that is None) == (self.figure is None):
            raise ValueError("an expectation needs either `that` (a formula) or `figure` (with at_least, at_most)")
        if self.that is not None:
            if self.at_least is not None or self.at_most is not None:
                raise ValueError("`at_least` and `at_most` go with `figure`")
        else:
            if self.figure not in FIGURES:
                raise ValueError(f"unknown figure `{self.figure}`; {nearest(str(self.figure), FIGURES)}")
            if self.at_least is None and self.at_most is None:
                raise ValueError("a figure needs `at_least`, `at_most` or both")
        return self


# Figures of a run that an expectation may bound, with what they mean (scenarios/hilscenario/verdict/figures.py computes them).
FIGURES = {
    "acts": "episodes of ACT: runs of ticks that assist one verb",
    "holds": "episodes of HOLD, the one that a run begins in counted",
    "coverage": "share of ticks under ACT",
    "act_only_precision": "share of ticks under ACT whose verb is the wearer's; n/a where none acted or nobody knows",
    "false_assists_per_min": "episodes of ACT whose first tick assists a wrong verb, a minute",
    "assist_s": "time in which assist was not zero, in s",
    "assist_energy_j": "mechanical work of assist and gravity support on the arm, both ways, in J",
    "max_assist_nm": "largest assist of the run, in N m",
    "zero_after_fault_ms": "longest time from the begin of a fault under assist until assist is zero, in ms",
    "trips": "faults that the device counted as trips",
    "frames_rejected": "frames that the device took in and refused",
    "frames_lost": "frames that one side sent and the other knows it missed",
}


class Scenario(_Part):
    """One scripted run of the whole system, and what must hold in it."""

    name: str = Field(min_length=1)
    about: str = ""
    hazards: tuple[Literal[HAZARDS], ...] = ()  # type: ignore[valid-type]
    seed: int = Field(1, ge=0)
    duration: Duration
    intent: Intent = "predictor"
    wearer: WearerPart = WearerPart()
    gate: GatePart = GatePart()
    bus: BusPart = BusPart()
    device: DevicePart = DevicePart()
    steps: tuple[Step, ...] = ()
    expect: tuple[Expectation, ...] = Field(min_length=1)
    sweep: dict[str, tuple[float | int | str, ...]] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _times(self) -> Scenario:
        if self.duration <= 0:
            raise ValueError("`duration` must be above zero")
        for number, step in enumerate(self.steps):
            if step.at is not None and step.at >= self.duration:
                late = f"begins at {step.at / 1e9:g} s, after the end at {self.duration / 1e9:g} s"
                raise PydanticCustomError("part", "{why}", {"why": late, "place": ("steps", number, "at")})
        return self

    @model_validator(mode="after")
    def _judgeable(self) -> Scenario:
        """Every formula is about signals and words that there are, and can have two verdicts."""
        domains = domains_of(step.fault for step in self.steps)
        formulas = [("steps", number, "when", step.when) for number, step in enumerate(self.steps)]
        formulas += [("expect", number, "that", expectation.that) for number, expectation in enumerate(self.expect)]
        for section, number, key, formula in formulas:
            if formula is None:
                continue
            why = formula_problem(formula, domains)
            if why is None and isinstance(self.intent, Session) and (unknown := signal_names(formula) & OF_THE_MIND):
                why = f"`{unknown.pop()}` has no value here: nobody wrote down what a recorded wearer intended"
            if why is not None:
                raise PydanticCustomError("part", "{why}", {"why": why, "place": (section, number, key)})
        return self

    @model_validator(mode="after")
    def _recorded_already(self) -> Scenario:
        if not isinstance(self.intent, Session):
            return self
        for number, step in enumerate(self.steps):
            if step.fault in self.intent.unchangeable:
                source = "features" if "gaze.garbage" in self.intent.unchangeable else "a session"
                why = f"`{step.fault}` changes what is seen, which {source} recorded already cannot show"
                raise PydanticCustomError("part", "{why}", {"why": why, "place": ("steps", number, "fault")})
        return self
