"""Obtains the hand model: the official file where the network allows, else assembled from a PyPI wheel. Hash-checked.

The official bundle is a zip (stored) of two TFLite networks; the wheel of mediapipe 0.10.21 carries the same two. Both
give the same landmarks. The file goes into the user's data folder and is never fetched while the bridge runs.
"""

from __future__ import annotations

import hashlib
import io
import os
import sys
import tempfile
import urllib.error
import urllib.request
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import platformdirs

from hilbridge.errors import InputError
from hilbridge.files import write_whole
from hilbridge.lease import run_leased

HAND_MODEL_URL = (
    "https://storage.googleapis.com/mediapipe-models/hand_landmarker/hand_landmarker/float16/1/hand_landmarker.task"
)
HAND_MODEL_SHA256 = "fbc2a30080c3c557093b5ddfc334698132eb341044ccee322ccf8bcf3607cde1"
WHEEL = "mediapipe==0.10.21"
_PART_LIMIT_BYTES = 64_000_000
# name in the bundle -> (file in the wheel, its sha256)
WHEEL_PARTS = {
    "hand_detector.tflite": (
        "mediapipe/modules/palm_detection/palm_detection_full.tflite",
        "1b14e9422c6ad006cde6581a46c8b90dd573c07ab7f3934b5589e7cea3f89a54",
    ),
    "hand_landmarks_detector.tflite": (
        "mediapipe/modules/hand_landmark/hand_landmark_full.tflite",
        "11c272b891e1a99ab034208e23937a8008388cf11ed2a9d776ed3d01d0ba00e3",
    ),
}


def hand_model_path() -> Path:
    """Where the hand model is kept: HILBRIDGE_MODELS, or the user's data folder."""
    folder = os.environ.get("HILBRIDGE_MODELS") or platformdirs.user_data_dir("hilbridge", appauthor=False)
    return Path(folder) / "hand_landmarker.task"


def hand_model_problem(path: Path) -> str | None:
    """Why the file at `path` is not the hand model, or None when it is (either of the two accepted contents)."""
    try:
        return _problem(path.read_bytes())
    except OSError as error:
        return "not there" if isinstance(error, FileNotFoundError) else f"cannot be read ({error.strerror})"


def load_hand_model(path: Path, sha256: str | None = None) -> bytes:
    """The content of the hand model, its hash checked: `sha256` of a file of one's own, or that of the pinned one.

    What is checked is what is given, whatever happens to the file afterwards. Raises InputError with the cure.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"hand model {path}: not there; get it once with `hilbridge fetch-models`") from None
    except OSError as error:
        raise InputError(
            f"hand model {path}: cannot be read ({error.strerror}); run `hilbridge fetch-models`"
        ) from None
    if sha256 is not None:
        found = hashlib.sha256(data).hexdigest()
        if found != sha256.lower():
            raise InputError(f"hand model {path}: its sha256 is {found}, not the {sha256.lower()} of hand_model_sha256")
        return data
    problem = _problem(data)
    if problem is not None:
        raise InputError(
            f"hand model {path}: {problem}; get the right one with `hilbridge fetch-models --force`, "
            "or give hand_model_sha256 for a file of your own"
        )
    return data


def _problem(data: bytes) -> str | None:
    if hashlib.sha256(data).hexdigest() == HAND_MODEL_SHA256:
        return None
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as bundle:
            for name, (_, digest) in WHEEL_PARTS.items():
                if bundle.getinfo(name).file_size > _PART_LIMIT_BYTES:
                    return f"{name} in it is too large"
                if hashlib.sha256(bundle.read(name)).hexdigest() != digest:
                    return f"{name} in it has another hash than the one pinned"
            if len(bundle.infolist()) != len(WHEEL_PARTS):
                return "more in it than the two networks"
    except (zipfile.BadZipFile, KeyError, NotImplementedError, RuntimeError, zlib.error, EOFError):
        return "neither the official file nor one assembled from the wheel"
    return None


def fetch_hand_model(
    path: Path, *, force: bool = False, say: Callable[[str], None] = lambda line: None, timeout_s: float = 20.0
) -> Path:
    """Make sure the hand model is at `path`. Writes it whole or not at all.

    Raises InputError when neither the network nor the package index gives it.
    """
    if not force and hand_model_problem(path) is None:
        say(f"hand model is already there: {path}")
        return path
    data = _official(say, timeout_s) or _from_wheel(say)
    write_whole(path, data)
    say(f"hand model stored: {path} ({len(data) / 1e6:.1f} MB)")
    return path


def _official(say: Callable[[str], None], timeout_s: float) -> bytes | None:
    try:
        with urllib.request.urlopen(HAND_MODEL_URL, timeout=timeout_s) as answer:
            data: bytes = answer.read(64_000_000)
    except (urllib.error.URLError, OSError) as error:
        say(f"official file not reachable ({error}); assembling it from the {WHEEL} wheel")
        return None
    if hashlib.sha256(data).hexdigest() != HAND_MODEL_SHA256:
        say("official file has another hash than the one pinned and is refused; assembling it from the wheel")
        return None
    return data


def _from_wheel(say: Callable[[str], None]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        # The networks are data: any interpreter's wheel of that version holds the same ones.
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--disable-pip-version-check"]
        target = ["--only-binary", ":all:", "--python-version", "3.11", "--platform", "manylinux_2_28_x86_64"]
        done = run_leased([*command, *target, "-d", folder, WHEEL])
        wheels = list(Path(folder).glob("*.whl"))
        if done.returncode or not wheels:
            reason = (done.stderr.strip().splitlines() or ["no wheel"])[-1]
            raise InputError(
                f"hand model: neither the official file nor the {WHEEL} wheel can be had ({reason}); "
                f"copy hand_landmarker.task by hand to {hand_model_path()}"
            )
        bundle = io.BytesIO()
        with zipfile.ZipFile(wheels[0]) as wheel, zipfile.ZipFile(bundle, "w", zipfile.ZIP_STORED) as out:
            for name, (inside, digest) in WHEEL_PARTS.items():
                content = wheel.read(inside)
                if hashlib.sha256(content).hexdigest() != digest:
                    raise InputError(f"hand model: {inside} in the {WHEEL} wheel has another hash than the one pinned")
                out.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), content)
        say("assembled from the wheel; hashes match")
        return bundle.getvalue()
