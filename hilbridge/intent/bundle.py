"""One file with all a running bridge needs of a trained predictor: safetensors, and the rest as JSON in its header.

A bundle is input from outside: whatever is wrong with the file ends in one BundleError that names it and the cure.
"""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from hilbridge.confidence import MASKS, ConfidenceMaps, RisingMap
from hilbridge.errors import InputError
from hilbridge.features.layout import LAYOUT_HASH, D
from hilbridge.files import write_whole
from hilbridge.intent.calibration import checked_temperatures
from hilbridge.intent.gru import Weights
from hilbridge.intent.online import ConfidenceDrift, Usual
from hilbridge.intent.provenance import Provenance, provenance_of
from hilbridge.intent.vectors import MAX_DIFFERENCE, WINDOWS, Vectors, largest_difference
from hilbridge.verbs import DEFAULT, VERBS, Vocabulary, stored_vocabulary

# Since 3 with maps of what the gate compares, a curve and a sealed record, since 4 with any vocabulary; a bundle of the
# default one is written as 3, for bridges that know no other.
FORMAT, DEFAULT_FORMAT = 4, 3
MAX_BYTES = 64 << 20
MAX_HIDDEN = 1024
MAX_WEIGHT = 1e5
METADATA_KEY = "hilbridge"
TENSORS = (
    "fc_weight",
    "fc_bias",
    "input_weight",
    "input_bias",
    "hidden_weight",
    "hidden_bias",
    "head_weight",
    "head_bias",
)
_STORED = (*TENSORS, "mean", "std", "vector_values", "vector_valid", "vector_logits")
CURE = "train one with `hilbridge train`, or leave the option out to use the demo bundle"


class BundleError(InputError):
    """The bundle cannot be used; the message names the file, what is wrong and what to do."""


@dataclass(frozen=True, slots=True)
class Thresholds:
    """The gate's thresholds chosen (or certified) for this predictor, 0 < tau_off < tau_on <= 1."""

    tau_on: float
    tau_off: float

    def __post_init__(self) -> None:
        if not 0.0 < self.tau_off < self.tau_on <= 1.0:
            raise ValueError(f"thresholds tau_on {self.tau_on}, tau_off {self.tau_off}: need 0 < tau_off < tau_on <= 1")


class Replayed(NamedTuple):
    """What the gate came to at `tau_on` on people that nothing was fitted on: act-only precision over all ticks, share of
    ticks in ACT; of the `people` who act at all, the mean of each one's precision and its standard deviation."""

    tau_on: float
    precision: float
    coverage: float
    people: float
    person_precision: float
    person_spread: float


@dataclass(frozen=True, slots=True)
class Bundle:
    """A trained predictor. mean, std: (D,) training statistics of raw features; bundle_id: 16 bits of its hash.

    temperatures: by mask of valid modalities. maps: from what the gate smooths to confidence. curve: the gate replayed at
    rising tau_on, where it acts. vectors: what the network gave when it was trained; `load_bundle` compares.
    person_spread: standard deviation over people of the log odds of being right; `hilbridge adapt` leans on it.
    vocabulary: what the classes are called, and which may be assisted.
    usual: bounds of the mean confidence of the people it was calibrated on (`online.ConfidenceDrift`).
    doubt: why the provenance that the file holds (or does not hold) cannot be believed.
    """

    weights: Weights
    mean: NDArray[np.float32]
    std: NDArray[np.float32]
    window_steps: int
    temperatures: Mapping[int, float]
    maps: ConfidenceMaps
    thresholds: Thresholds
    curve: tuple[Replayed, ...]
    vectors: Vectors
    person_spread: float = 0.0
    provenance: Provenance | None = None
    doubt: str | None = None
    bundle_id: int = 0
    vocabulary: Vocabulary = DEFAULT
    usual: Usual | None = None

    def tau_for(self, precision: float) -> float | None:
        """The lowest tau_on from which on the replayed gate reaches `precision`; None where none does."""
        found = None
        for point in reversed(self.curve):
            if point.precision < precision:
                break
            found = point.tau_on
        return found


def demo_bundle_path() -> Path:
    """The bundle that ships with the package, trained on the simulated wearer."""
    return Path(str(files("hilbridge.intent") / "demo_bundle.safetensors"))


def save_bundle(bundle: Bundle, path: Path) -> Path:
    """Write `bundle` to `path`, whole or not at all."""
    tensors = {name: np.ascontiguousarray(getattr(bundle.weights, name), dtype=np.float32) for name in TENSORS}
    tensors["mean"] = np.ascontiguousarray(bundle.mean, dtype=np.float32)
    tensors["std"] = np.ascontiguousarray(bundle.std, dtype=np.float32)
    vectors = bundle.vectors
    tensors["vector_values"] = np.ascontiguousarray(vectors.values, dtype=np.float32)
    tensors["vector_valid"] = np.ascontiguousarray(vectors.valid, dtype=np.float32)
    tensors["vector_logits"] = np.ascontiguousarray(vectors.logits, dtype=np.float32)
    metadata: dict[str, Any] = {
        "format": DEFAULT_FORMAT,
        "layout_hash": LAYOUT_HASH,
        "verbs": list(bundle.vocabulary.names),
        "window_steps": bundle.window_steps,
        "temperatures": {str(mask): value for mask, value in sorted(bundle.temperatures.items())},
        "maps": {str(condition): [own.x, own.y] for condition, own in sorted(bundle.maps.by_condition.items())},
        "thresholds": {"tau_on": bundle.thresholds.tau_on, "tau_off": bundle.thresholds.tau_off},
        "curve": [list(point) for point in bundle.curve],
        "person_spread": bundle.person_spread,
        "provenance": None if bundle.provenance is None else bundle.provenance.as_json(),
    }
    if bundle.usual is not None:
        metadata["usual"] = list(bundle.usual)
    if bundle.vocabulary != DEFAULT:
        metadata |= {"format": FORMAT, "assisted": list(bundle.vocabulary.assisted)}
    metadata["seal"] = seal_of(tensors, metadata)
    return write_whole(path, save(tensors, metadata={METADATA_KEY: json.dumps(metadata, sort_keys=True)}))


def seal_of(tensors: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any]) -> str:
    """SHA-256 over all that a bundle says and all of its tensors."""
    said = {key: value for key, value in metadata.items() if key != "seal"}
    digest = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
    for name in sorted(tensors):
        array = np.ascontiguousarray(tensors[name])
        digest.update(f"{name} {array.dtype} {array.shape}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def load_bundle(path: Path | str) -> Bundle:
    """Read and check a bundle. Raises BundleError for any file that is not a whole, matching, finite bundle."""
    path = Path(path)
    data = _read(path)
    metadata = _metadata(path, data)
    _check_match(path, metadata)
    try:
        tensors = load(data)
    except (SafetensorError, ValueError, KeyError, TypeError, MemoryError) as error:
        raise BundleError(f"{path}: not a whole safetensors file ({error}); copy it again or {CURE}") from None
    try:
        return _assemble(tensors, metadata, int.from_bytes(hashlib.sha256(data).digest()[:2], "big"))
    except BundleError as error:
        raise BundleError(f"{path}: {error}; {CURE}") from None
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise BundleError(f"{path}: unusable bundle ({type(error).__name__}: {error}); {CURE}") from None


def _read(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if not path.is_file():
            raise BundleError(f"{path}: not a file; {CURE}")
        if size > MAX_BYTES:
            raise BundleError(f"{path}: {size} bytes, larger than any bundle ({MAX_BYTES}); {CURE}")
        return path.read_bytes()
    except OSError as error:
        raise BundleError(f"{path}: cannot be read ({error.strerror or error}); {CURE}") from None


def _metadata(path: Path, data: bytes) -> dict[str, Any]:
    """The JSON in the header, read by hand: safetensors gives metadata only from files on disk."""
    try:
        (length,) = struct.unpack_from("<Q", data)
        if length > len(data) - 8:
            raise ValueError("header is cut off")
        metadata = json.loads(json.loads(data[8 : 8 + length])["__metadata__"][METADATA_KEY])
        if not isinstance(metadata, dict):
            raise ValueError("header is not an object")
        return metadata
    except (struct.error, ValueError, KeyError, TypeError, RecursionError) as error:
        detail = f"{type(error).__name__}: {error}"[:120]
        raise BundleError(f"{path}: not a hilbridge bundle or truncated ({detail}); copy it again or {CURE}") from None


def _check_match(path: Path, metadata: Mapping[str, Any]) -> None:
    if metadata.get("format") not in (DEFAULT_FORMAT, FORMAT):
        raise BundleError(
            f"{path}: bundle format {metadata.get('format')!r}, this version reads {DEFAULT_FORMAT} and {FORMAT}; {CURE}"
        )
    if metadata.get("layout_hash") != LAYOUT_HASH:
        raise BundleError(f"{path}: trained on another feature layout than this version's; {CURE}")
    if metadata["format"] == DEFAULT_FORMAT and metadata.get("verbs") != list(VERBS):
        raise BundleError(f"{path}: trained on other verbs than this version's; {CURE}")


def _assemble(tensors: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any], bundle_id: int) -> Bundle:
    window_steps = metadata["window_steps"]
    if not isinstance(window_steps, int) or not 2 <= window_steps <= 250:
        raise BundleError(f"window of {window_steps!r} steps, expected 2 to 250")
    is_default = metadata["format"] == DEFAULT_FORMAT
    vocabulary = DEFAULT if is_default else stored_vocabulary(metadata["verbs"], metadata["assisted"])
    arrays = _checked(tensors, window_steps, len(vocabulary))
    weights = Weights(**{name: arrays[name] for name in TENSORS})
    vectors = Vectors(arrays["vector_values"], arrays["vector_valid"] > 0, arrays["vector_logits"])
    difference = largest_difference(weights, arrays["mean"], arrays["std"], window_steps, vectors)
    if not difference <= MAX_DIFFERENCE:  # NaN fails the comparison
        raise BundleError(
            f"its network gives other logits than when it was trained (by {difference:.3g}, at most {MAX_DIFFERENCE:g}): "
            "tensors were exchanged or edited"
        )
    provenance, doubt = _provenance(tensors, metadata)
    return Bundle(
        weights,
        arrays["mean"],
        arrays["std"],
        window_steps,
        checked_temperatures({int(mask): float(value) for mask, value in metadata["temperatures"].items()}),
        _maps(metadata["maps"]),
        Thresholds(float(metadata["thresholds"]["tau_on"]), float(metadata["thresholds"]["tau_off"])),
        _curve(metadata["curve"]),
        vectors,
        _spread(metadata["person_spread"]),
        provenance,
        doubt,
        bundle_id,
        vocabulary,
        _usual(metadata.get("usual")),
    )


def _usual(raw: Any) -> Usual | None:
    if raw is None:
        return None
    low, high, condition = raw
    return ConfidenceDrift(
        Usual(float(low), float(high), int(condition))
    ).usual  # raises ValueError for bounds that are none


def _provenance(
    tensors: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any]
) -> tuple[Provenance | None, str | None]:
    """The record and why it cannot be believed. Predicting needs none; acting on a physical bus does."""
    raw = metadata.get("provenance")
    if raw is None:
        return None, "it has no provenance"
    try:
        record = provenance_of(raw)
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        return None, f"its provenance cannot be read ({type(error).__name__}: {error})"[:160]
    if metadata.get("seal") != seal_of(tensors, metadata):
        return record, "it was edited after it was sealed"
    return record, None


def _spread(raw: Any) -> float:
    if not 0.0 <= float(raw) <= 10.0:
        raise BundleError(f"spread over people of {raw!r} log odds, expected 0 to 10")
    return float(raw)


def _maps(raw: Mapping[str, Any]) -> ConfidenceMaps:
    made = ConfidenceMaps({int(condition): RisingMap(_floats(x), _floats(y)) for condition, (x, y) in raw.items()})
    absent = [mask for mask in MASKS if mask not in made.by_condition]
    if absent:
        raise BundleError(f"no map for the modalities of mask {absent[0]}")
    return made


def _curve(raw: Sequence[Sequence[Any]]) -> tuple[Replayed, ...]:
    made = tuple(Replayed(*_floats(point)) for point in raw)
    if not all(0.0 <= number <= 1.0 or number == point.people >= 0.0 for point in made for number in point):
        raise BundleError("its replayed curve has numbers outside of 0..1")
    if [point.tau_on for point in made] != sorted({point.tau_on for point in made}):
        raise BundleError("its replayed curve does not rise in tau_on")
    return made


def _checked(tensors: Mapping[str, NDArray[Any]], window_steps: int, verbs: int) -> dict[str, NDArray[np.float32]]:
    """All tensors as float32: there, finite, and of shapes that fit together. Raises BundleError."""
    missing = [name for name in _STORED if name not in tensors]
    if missing:
        raise BundleError(f"tensor {missing[0]} is missing")
    arrays = {name: np.asarray(tensors[name]) for name in _STORED}
    for name, array in arrays.items():
        if array.dtype not in (np.float32, np.float16) or array.ndim not in (1, 2) or array.size == 0:
            raise BundleError(f"tensor {name} is no float32 or float16 vector or matrix")
        # NaN fails the comparison; a larger weight than this overflows instead of predicting.
        if not float(np.abs(array.astype(np.float64)).max()) <= MAX_WEIGHT:
            raise BundleError(f"tensor {name} has a number that is not finite or beyond {MAX_WEIGHT:g}")
    hidden, inner = arrays["hidden_weight"].shape[-1], arrays["fc_bias"].shape[0]
    shapes = {
        "fc_weight": (inner, D),
        "fc_bias": (inner,),
        "input_weight": (3 * hidden, inner),
        "input_bias": (3 * hidden,),
        "hidden_weight": (3 * hidden, hidden),
        "hidden_bias": (3 * hidden,),
        "head_weight": (verbs, hidden),
        "head_bias": (verbs,),
        "mean": (D,),
        "std": (D,),
        "vector_values": (window_steps + WINDOWS - 1, D),
        "vector_valid": (window_steps + WINDOWS - 1, 3),
        "vector_logits": (WINDOWS, verbs),
    }
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise BundleError(f"tensor {name} has shape {arrays[name].shape}, expected {shape}")
    if not 0 < hidden <= MAX_HIDDEN or not (arrays["std"] > 0).all():
        raise BundleError(f"hidden size {hidden} or a standard deviation is out of range")
    return {name: np.ascontiguousarray(array, dtype=np.float32) for name, array in arrays.items()}


def _floats(numbers: Sequence[Any]) -> tuple[float, ...]:
    return tuple(float(number) for number in numbers)
