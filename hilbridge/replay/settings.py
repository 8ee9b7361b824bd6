"""With what a recording is replayed: its own settings, another bundle, and what-ifs laid over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from hilbridge.config import GateSection
from hilbridge.core.gate import GateConfig
from hilbridge.errors import InputError, nearest
from hilbridge.features.packs import file_hash
from hilbridge.intent.bundle import Bundle, demo_bundle_path, load_bundle
from hilbridge.limits import MS
from hilbridge.rows import BundleRow, ConfigRow
from hilbridge.verbs import Vocabulary

_NAMES = tuple(name for name in GateSection.model_fields if name != "precision")  # a bundle's, not a number of the gate


@dataclass(frozen=True, slots=True)
class Settings:
    """bundle: to predict with, None where beliefs are recorded ones. same_bundle: the very one of the recording."""

    gate: GateConfig
    bundle: Bundle | None
    same_bundle: bool
    what_if: tuple[str, ...]


def settings_for(
    name: str, config: ConfigRow | None, recorded: BundleRow | None, bundle: Path | None, what_if: Sequence[str]
) -> Settings:
    """Settle bundle and gate. Raises InputError; `name` is the recording's."""
    if config is None or recorded is None or not config.settings.get("gate_in_force"):
        raise InputError(
            f"recording {name}: has no /config and /bundle rows; only what is recorded from now on replays"
        )
    path = bundle or _bundle_of(config.settings)
    loaded = load_bundle(path)
    same = file_hash(path) == recorded.sha256
    asked = _asked(config.settings)
    values: dict[str, Any] = dict(config.settings["gate_in_force"])
    if not same:  # another bundle has thresholds of its own, where nobody had asked for others
        own = {"tau_on": loaded.thresholds.tau_on, "tau_off": loaded.thresholds.tau_off}
        values |= {key: value for key, value in own.items() if asked.get(key) is None}
    known = {field.name for field in fields(GateConfig)}
    values = {key: value for key, value in values.items() if key in known} | _laid_over(what_if)
    try:
        own_verbs = _never_assisted(loaded, config.settings["gate_in_force"])
        of_bundle: dict[str, Any] = {"maps": loaded.maps, "vocabulary": own_verbs, "usual": loaded.usual}
        return Settings(GateConfig(**values, **of_bundle), loaded, same, tuple(what_if))
    except (ValueError, TypeError) as error:
        raise InputError(f"replay of {name}: gate: {error}; give --what-if gate.tau_on=... that fits") from None


def _never_assisted(bundle: Bundle, in_force: Mapping[str, Any]) -> Vocabulary:
    """The bundle's verbs, less what the recorded run's bus had no name for."""
    verbs, never = bundle.vocabulary, in_force.get("never_assisted", ())
    held = {index for index, name in enumerate(verbs.names) if name in never}
    return replace(verbs, never_assisted=verbs.never_assisted | held)


def _bundle_of(settings: Mapping[str, Any]) -> Path:
    """The bundle that the recording names where it still is there, else the one that ships."""
    model = settings.get("model")
    named = model.get("bundle") if isinstance(model, Mapping) else None
    return Path(named) if isinstance(named, str) and Path(named).is_file() else demo_bundle_path()


def _asked(settings: Mapping[str, Any]) -> Mapping[str, Any]:
    scenario = settings.get("scenario")
    asked = (scenario if isinstance(scenario, Mapping) else settings).get("gate")
    return asked if isinstance(asked, Mapping) else {}


def _laid_over(what_if: Sequence[str]) -> dict[str, Any]:
    """`gate.NAME=NUMBER`, each checked as the configuration checks it. Raises InputError."""
    given: dict[str, Any] = {}
    for text in what_if:
        key, sign, value = text.partition("=")
        section, _, name = key.strip().partition(".")
        if not sign or section != "gate" or name not in _NAMES:
            hint = nearest(f"gate.{name or section}", [f"gate.{one}" for one in _NAMES])
            raise InputError(f"--what-if {text}: no such setting; {hint}")
        given[name] = _number(text, value)
    try:
        section_given = GateSection.model_validate(given)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(
            f"--what-if gate.{'.'.join(map(str, first['loc']))}: {first['msg']}; give another value"
        ) from None
    over = section_given.model_dump(include=set(given))
    return {name.replace("_ms", "_ns"): value * MS if name.endswith("_ms") else value for name, value in over.items()}


def _number(text: str, value: str) -> int | float:
    for kind in (int, float):
        try:
            return kind(value)
        except ValueError:
            continue
    raise InputError(f"--what-if {text}: `{value}` is no number; write gate.tau_on=0.7")
