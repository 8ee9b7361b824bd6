"""bridge.toml -> one frozen configuration. Unknown keys are refused; every error names the file and the key.

What the command line gives wins over the file. No value here switches a watchdog off: limits that guard the wearer can
only be made tighter than the contract's.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from hilbridge.errors import InputError
from hilbridge.limits import FREEZE_LIMIT_MAX_MS, FREEZE_LIMIT_MS, REFRACTORY_MS, SENSING_LIMIT_MS, SENSOR_TIMEOUT_MS


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class LslSection(_Part):
    """Which channel of a Lab Streaming Layer gaze stream holds what, by its number or its label."""

    x: Annotated[int, Field(ge=0)] | str = 0
    y: Annotated[int, Field(ge=0)] | str = 1
    width: Annotated[float, Field(gt=0.0, description="x is divided by it: pixels of the scene picture, or 1")] = 1.0
    height: Annotated[float, Field(gt=0.0, description="y is divided by it")] = 1.0
    y_up: bool = Field(False, description="y counts from below, as in Pupil Core's norm_pos")
    valid: Annotated[int, Field(ge=0)] | str | None = Field(None, description="channel of validity or confidence")
    valid_from: float = Field(0.5, description="gaze is valid where that channel is at least so much")
    worn: Annotated[int, Field(ge=0)] | str | None = Field(None, description="channel above 0 while worn")


class LensSection(_Part):
    """A camera's intrinsics, as cv2.calibrateCamera gives them, and the size of the pictures that they were made of."""

    width: Annotated[int, Field(gt=0)]
    height: Annotated[int, Field(gt=0)]
    matrix: list[float] = Field(description="fx, fy, cx, cy in pixels")
    distortion: list[float] = Field(description="4, 5 or 8 coefficients")


class SensorsConfig(_Part):
    """Where pictures and gaze come from, and how long each may be silent before the bridge holds."""

    camera: str | None = Field(
        None, description="device index, video file, rtsp:// URL, or neon: (of the glasses in `gaze`)"
    )
    camera_fps: Annotated[float, Field(ge=1.0, le=240.0)] | None = Field(
        None, description="rate to ask a camera for, or to play a file at; default: its own"
    )
    camera_latency_ms: Annotated[float, Field(ge=0.0, le=100.0)] = Field(
        0.0, description="age of a picture on arrival (exposure, transfer), where its driver gives no stamp"
    )
    camera_reader: Literal["auto", "pyav", "opencv"] = Field(
        "auto", description="what reads pictures; auto: PyAV for streams where it is installed, else OpenCV"
    )
    gaze: str | None = Field(
        None, description="neon:[HOST], lsl:STREAM, udp:PORT; or a Neon recording folder, BeGaze .txt, or .csv"
    )
    gaze_latency_ms: Annotated[float, Field(ge=0.0, le=100.0)] = Field(
        0.0, description="age of a sample on arrival, where the sender gives no stamp (udp)"
    )
    gaze_offset_ms: Annotated[float, Field(ge=-1000.0, le=1000.0)] = Field(
        0.0, description="added to the stamps of gaze, where it shares no clock with the camera (`hilbridge align`)"
    )
    inertial_offset_ms: Annotated[float, Field(ge=-1000.0, le=1000.0)] = Field(
        0.0, description="added to the stamps of inertial sensors, likewise"
    )
    gaze_homography: list[float] | None = Field(
        None, description="nine numbers, row by row: from 0..1 of the eye tracker's picture to 0..1 of the camera's"
    )
    gaze_lens: LensSection | None = Field(
        None,
        description="intrinsics of the eye tracker's scene camera: gaze is straightened by them before the homography",
    )
    camera_lens: LensSection | None = Field(
        None, description="intrinsics of the camera: gaze is bent by them after the homography"
    )
    gaze_same_camera: bool = Field(False, description="the camera shows the eye tracker's own scene picture")
    lsl: LslSection = LslSection()
    inertial: str | None = Field(
        None, description="hand acceleration for the tremor guard: lsl:STREAM, udp:PORT, or an iAssistADL folder"
    )
    skeleton: str | None = Field(
        None, description="wrists that stand in for hands the camera does not see: lsl:STREAM, udp:PORT, or a folder"
    )
    skeleton_projection: list[float] | None = Field(
        None, description="twelve numbers, row by row: from metres of the skeleton to 0..1 of the camera's picture"
    )
    hands: bool = Field(True, description="find hands with MediaPipe (extra `hands`)")
    hand_detector: str | None = Field(
        None, description="a detector of one's own instead: package.module:Name, made in a process of its own"
    )
    hand_model: str | None = Field(None, description="hand_landmarker.task; default: the user's data folder")
    hand_model_sha256: str | None = Field(
        None, pattern=r"^[0-9A-Fa-f]{64}$", description="of a hand model of one's own; default: only the pinned one"
    )
    loop: bool = Field(False, description="start a recording again at its end")
    camera_timeout_ms: Annotated[int, Field(gt=0, le=SENSING_LIMIT_MS)] = SENSOR_TIMEOUT_MS
    gaze_timeout_ms: Annotated[int, Field(gt=0, le=SENSING_LIMIT_MS)] = SENSOR_TIMEOUT_MS
    inertial_timeout_ms: Annotated[int, Field(gt=0, le=SENSING_LIMIT_MS)] = SENSOR_TIMEOUT_MS
    freeze_ms: Annotated[
        int, Field(gt=0, le=FREEZE_LIMIT_MAX_MS, description="identical pictures for so long are a frozen camera")
    ] = FREEZE_LIMIT_MS


class ModelConfig(_Part):
    """The bundle to predict with."""

    bundle: str | None = Field(None, description="a .safetensors bundle; default: the one that ships")


class GateSection(_Part):
    """The gate (paper, E5). Thresholds left out come from the bundle."""

    tau_on: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    tau_off: Annotated[float, Field(ge=0.0, lt=1.0)] | None = None
    precision: Annotated[float, Field(gt=0.0, lt=1.0)] | None = Field(
        None, description="the lowest tau_on from which on the bundle's replay reaches it; tau_on, where given, wins"
    )
    alpha: Annotated[float, Field(gt=0.0, le=1.0)] = 0.2
    top_k: Annotated[int, Field(ge=1, le=21)] = 3
    refractory_ms: Annotated[int, Field(ge=0, le=10_000)] = REFRACTORY_MS
    max_age_ms: Annotated[int, Field(gt=0, le=SENSING_LIMIT_MS)] = SENSING_LIMIT_MS

    @model_validator(mode="after")
    def _band(self) -> GateSection:
        if self.tau_on is not None and self.tau_off is not None and self.tau_off >= self.tau_on:
            raise ValueError(f"tau_off = {self.tau_off} must be below tau_on = {self.tau_on}")
        return self


class BusConfig(_Part):
    """The bus. On a physical bus the bridge listens only until `arm` is set."""

    spec: str = Field("auto", description="auto, vcan0, can0, or any python-can interface:channel")
    options: dict[str, Any] = Field({}, description="go to python-can as they are: bitrate, can_filters, fd ...")
    dbc: str | None = Field(None, description="DBC file; default: the one that ships")
    key_file: str | None = Field(
        None, description="16-byte key as hex, mode 0600; default: the demo key (virtual only)"
    )
    listen_only: bool | None = Field(None, description="default: true on a physical bus, false on a virtual one")
    arm: bool = Field(False, description="may send ACT on a physical bus")
    uncertified: bool = Field(False, description="a bench: arm with a bundle of recorded people without a certificate")


PSEUDONYM = r"^[A-Za-z0-9_-]*[0-9][A-Za-z0-9_-]*$"  # with a digit, as names do not have


class RecordingConfig(_Part):
    """What a run's recording holds, and when its next part begins."""

    video: bool = Field(True, description="keep the pictures of the head camera, as JPEG")
    video_quality: Annotated[int, Field(ge=1, le=100, description="of JPEG")] = 80
    video_width_px: Annotated[int, Field(ge=16, le=8192, description="wider pictures are made so wide")] = 640
    blur_faces: bool = Field(False, description="blur faces in pictures that are kept (extra privacy)")
    participant: Annotated[str, Field(pattern=PSEUDONYM, max_length=32)] | None = Field(
        None, description="the wearer's pseudonym: letters, digits, - and _, such as P-07; never a name"
    )
    rotate_mb: Annotated[float, Field(ge=0.1)] | None = Field(None, description="the next part after so many megabytes")
    rotate_minutes: Annotated[float, Field(ge=0.05)] | None = Field(None, description="... or after so many minutes")
    retain_days: Annotated[float, Field(gt=0.0)] | None = Field(
        None, description="older recordings beside this run's are removed when it is over"
    )


class MonitorConfig(_Part):
    """What a monitor on this computer is shown beside the bus."""

    share_pictures: bool = Field(
        False, description="show the head camera's picture with gaze and hands to monitors of the same user"
    )


class Config(_Part):
    """Everything the bridge can be told."""

    sensors: SensorsConfig = SensorsConfig()
    model: ModelConfig = ModelConfig()
    gate: GateSection = GateSection()
    bus: BusConfig = BusConfig()
    recording: RecordingConfig = RecordingConfig()
    monitor: MonitorConfig = MonitorConfig()


def load_config(path: Path | None, overrides: dict[str, dict[str, object]] | None = None) -> Config:
    """Read a TOML file (None: defaults) and lay `overrides` (section -> key -> value, None skipped) over it.

    Raises InputError with one line: file, key, value, cure.
    """
    name = str(path) if path else "command line"
    data: dict[str, object] = {}
    if path is not None:
        try:
            data = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        except FileNotFoundError:
            raise InputError(
                f"config {path}: no such file; write one (`hilbridge docs configuration`) or leave --config out"
            ) from None
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise InputError(f"config {path}: not readable as TOML: {error}") from None
    for section, values in (overrides or {}).items():
        given = {key: value for key, value in values.items() if value is not None}
        table = data.get(section, {})
        if given and isinstance(table, dict):
            data[section] = {**table, **{key: _over(table.get(key), value) for key, value in given.items()}}
    try:
        return Config.model_validate(data)
    except ValidationError as error:
        raise InputError(f"config {name}: {_one_line(error)}") from None


def parse_options(texts: Iterable[str]) -> dict[str, Any]:
    """KEY=VALUE each, a value as in TOML, else a word. Raises InputError."""
    options: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals or not key.isidentifier():
            raise InputError(f"--bus-option {text!r}: write KEY=VALUE, such as bitrate=500000")
        options[key] = _toml_value(value)
    return options


def _toml_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, KeyError):
        return text


def _over(file: object, given: object) -> object:
    """What is given over what the file has; of a table key by key."""
    return {**file, **given} if isinstance(file, dict) and isinstance(given, dict) else given


def _one_line(error: ValidationError) -> str:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        parent: type[BaseModel] = Config
        for part in first["loc"][:-1]:
            annotation = parent.model_fields[str(part)].annotation
            assert isinstance(annotation, type)
            parent = annotation
        near = difflib.get_close_matches(str(first["loc"][-1]), parent.model_fields, n=1)
        known = f"did you mean `{near[0]}`?" if near else f"known here: {', '.join(parent.model_fields)}"
        return f"unknown key `{key}`; {known}"
    value = first["input"]
    shown = "" if isinstance(value, dict) else f" = {value!r}"
    return f"`{key}`{shown}: {first['msg']}" if key else str(first["msg"])
