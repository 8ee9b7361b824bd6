"""The scenario format: flat YAML, strict, read into one frozen object that the Python builder makes as well.

Unknown keys are refused with file and line, and every error offers the nearest valid name.
"""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from hilbridge.errors import InputError
from hilbridge.verbs import VERBS
from scenarios.format.durations import Duration
from scenarios.format.vocabulary import SENSORS, checked_options, fault_kind
from scenarios.signals.stl import FormulaError, parse

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


class GatePart(_Part):
    """The gate's operating point; what is left out comes from the bundle."""

    tau_on: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    tau_off: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None
    refractory: Duration = 240_000_000  # ns, as every parsed duration
    alpha: Annotated[float, Field(gt=0.0, le=1.0)] = 0.2


class Estimate(_Part):
    """From `at` on, a scripted predictor believes in `verb` with `confidence`."""

    at: Duration
    verb: str
    confidence: Annotated[float, Field(ge=0.0, le=1.0)]

    @field_validator("verb")
    @classmethod
    def _known(cls, verb: str) -> str:
        if verb not in VERBS:
            near = difflib.get_close_matches(verb, VERBS, n=1)
            raise ValueError(f"unknown verb `{verb}`; " + (f"did you mean `{near[0]}`?" if near else f"known: {VERBS}"))
        return verb


class Session(_Part):
    """A recorded session as the source of intent: a feature pack, an earlier run, or video and gaze.

    Files are looked for beside the scenario's own file.
    """

    features: str | None = Field(None, description="feature pack (.npz) of `hilbridge data pack`")
    recording: str | None = Field(None, description="MCAP recording of an earlier run: its beliefs, replayed")
    video: str | None = Field(None, description="what the head camera saw; goes with `gaze`")
    gaze: str | None = Field(None, description="Neon folder, BeGaze .txt or .csv; goes with `video`")
    hands: bool = Field(False, description="find hands in the video (extra `hands`)")
    from_: Annotated[Duration, Field(alias="from", description="where in the session the scenario begins")] = 0

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    @model_validator(mode="after")
    def _one_source(self) -> Session:
        given = [name for name in ("features", "recording", "video") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                f"a session has one of features, recording, video; this has {' and '.join(given) or 'none'}"
            )
        if (self.video is None) != (self.gaze is None):
            raise ValueError("`video` and `gaze` go together")
        if self.hands and self.video is None:
            raise ValueError("`hands` are looked for in a `video`")
        return self

    @property
    def unchangeable(self) -> tuple[str, ...]:
        """Faults that would have to change what has been recorded already: names, or their beginnings and ends."""
        if self.recording is not None:
            return ()
        if self.features is not None:
            kinds = ("stuck", "garbage", "wrong", "drift")
            sensors = tuple(f"{sensor}.{kind}" for sensor in SENSORS for kind in kinds)
            wearer = ("tremor", "ataxia", "blink", "look_away", "hands_out_of_view")
            return (*sensors, *(f"wearer.{kind}" for kind in wearer))
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
    """One fault and when it strikes: `at` a time, `every` so often from `at` on, or `when` a condition first holds."""

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
        if self.when is not None:
            if self.every is not None:
                raise ValueError("`every` goes with `at`, not with `when`")
            _readable(self.when)
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
            _readable(self.that)
        else:
            if self.figure not in FIGURES:
                near = difflib.get_close_matches(str(self.figure), FIGURES, n=1)
                hint = f"did you mean `{near[0]}`?" if near else f"known: {', '.join(FIGURES)}"
                raise ValueError(f"unknown figure `{self.figure}`; {hint}")
            if self.at_least is None and self.at_most is None:
                raise ValueError("a figure needs `at_least`, `at_most` or both")
        return self


# Figures of a run that an expectation may bound (scenarios/verdict/figures.py computes them).
FIGURES = (
    "acts",
    "holds",
    "coverage",
    "act_only_precision",
    "false_assists_per_min",
    "assist_s",
    "assist_energy_j",
    "max_assist_nm",
    "zero_after_fault_ms",
    "trips",
    "frames_rejected",
    "frames_lost",
)


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
                late = f"strikes at {step.at / 1e9:g} s, after the end at {self.duration / 1e9:g} s"
                raise PydanticCustomError("step", "{why}", {"why": late, "step": number, "key": "at"})
        return self

    @model_validator(mode="after")
    def _recorded_already(self) -> Scenario:
        if not isinstance(self.intent, Session):
            return self
        for number, step in enumerate(self.steps):
            if step.fault in self.intent.unchangeable:
                source = "features" if self.intent.features is not None else "a video"
                why = f"`{step.fault}` changes what is seen, which {source} recorded already cannot show"
                raise PydanticCustomError("step", "{why}", {"why": why, "step": number, "key": "fault"})
        return self


def _readable(formula: str) -> None:
    try:
        parse(formula)
    except FormulaError as error:
        raise ValueError(str(error)) from None


def load_scenario(path: Path) -> Scenario:
    """Read a YAML scenario. Raises InputError: one line with file, line, what is wrong and the nearest valid name."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = mark.line + 1 if mark is not None else 1
        raise InputError(f"{path}:{line}: not readable as YAML: {getattr(error, 'problem', error)}") from None
    if not isinstance(data, dict):
        raise InputError(f"{path}:1: a scenario is a mapping with `name`, `duration` and `expect`")
    if isinstance(data.get("intent"), dict):
        data["intent"] = _beside(path, data["intent"])
    return scenario_of(data, where=lambda location: f"{path}:{_line(root, location)}")


def _beside(path: Path, session: dict[str, Any]) -> dict[str, Any]:
    """A recorded session with its files' whole paths."""
    files = ("features", "recording", "video", "gaze")
    return {
        key: str((path.parent / value).resolve()) if key in files and isinstance(value, str) else value
        for key, value in session.items()
    }


def scenario_of(data: dict[str, Any], where: Any = lambda location: "scenario") -> Scenario:
    """The Python builder's form of the same. Raises InputError naming the place that `where` gives to a location."""
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        chosen = max(error.errors(), key=_aptness)
        location = _location(chosen)
        raise InputError(f"{where(location)}: {_explain(chosen, location)}") from None


def _location(error: ErrorDetails) -> tuple[int | str, ...]:
    """Where in the file: pydantic's own names for the members of a union (`tuple[Estimate, ...]`) are left out."""
    if error["type"] == "step":
        return ("steps", error["ctx"]["step"], error["ctx"]["key"])
    return tuple(part for part in error["loc"] if isinstance(part, int) or "[" not in part)


def _aptness(error: ErrorDetails) -> tuple[bool, int]:
    """A misspelt key says more than the key that is then missing; a deep error more than a union's other member."""
    return error["type"] == "extra_forbidden", len(_location(error))


def _explain(error: ErrorDetails, location: tuple[int | str, ...]) -> str:
    key = ".".join(str(part + 1) if isinstance(part, int) else part for part in location)
    if error["type"] == "extra_forbidden":
        known = _keys_at(location[:-1])
        near = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.5)
        return f"unknown key `{key}`; " + (f"did you mean `{near[0]}`?" if near else f"known here: {', '.join(known)}")
    if error["type"] == "missing":
        return f"`{key}` is missing"
    message = str(error["msg"]).removeprefix("Value error, ")
    return f"`{key}`: {message}" if key else message


def _keys_at(location: tuple[int | str, ...]) -> list[str]:
    parts: dict[str, type[BaseModel]] = {
        "wearer": WearerPart,
        "gate": GatePart,
        "bus": BusPart,
        "device": DevicePart,
        "steps": Step,
        "expect": Expectation,
        "intent": Estimate,
    }
    model = parts.get(str(location[0]), Scenario) if location else Scenario
    if location == ("intent",):
        model = Session
    return [field.alias or name for name, field in model.model_fields.items()]


def _line(node: Any, location: tuple[int | str, ...]) -> int:
    """The line of the deepest part of `location` that the file has."""
    line = 1 if node is None else node.start_mark.line + 1
    for part in location:
        found = None
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                if key.value == str(part):
                    line, found = key.start_mark.line + 1, value
        elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
            found = node.value[part]
            line = found.start_mark.line + 1
        if found is None:
            return int(line)
        node = found
    return int(line)


def line_of(path: Path, location: tuple[int | str, ...]) -> int:
    """The line of a scenario file that has that part of it; 1 for a file that has changed under us."""
    try:
        root = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return 1
    return _line(root, location)


def reseeded(scenario: Scenario, seed: int | None) -> Scenario:
    """The same scenario with another seed; None leaves it as it is."""
    return scenario if seed is None else scenario.model_copy(update={"seed": seed})


def dump_scenario(scenario: Scenario) -> str:
    """YAML that `load_scenario` reads back to an equal object; what has its default is left out."""
    data = scenario.model_dump(mode="json", by_alias=True, exclude_defaults=True, exclude_none=True)
    text: str = yaml.safe_dump(data, sort_keys=False, width=110, allow_unicode=True)
    return text
