"""`hilbridge tune`: recordings of one wearer in, a proposal out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from hilbridge.config import load_config
from hilbridge.errors import InputError, needs_extra
from hilbridge.intent.bundle import Bundle, demo_bundle_path, load_bundle
from hilbridge.learning.data.people import Naming
from hilbridge.people.recordings import recorded_session
from hilbridge.tune.device import Asked, Profiles, propose
from hilbridge.tune.motion import Motion, is_recording, motion_of, one_person
from hilbridge.tune.page import config_with, diff_of, rows_of, to_sign
from hilbridge.tune.threshold import Own, Threshold, threshold_for

Say = Callable[[str], None]
CONFIG, PROFILES = "bridge.toml", "profiles.toml"


@dataclass(frozen=True, slots=True)
class Wish:
    """precision: what ACT is to keep. config: the bridge.toml in use, if any. bundle: wins over the configuration's."""

    files: tuple[Path, ...]
    precision: float
    device: Asked
    bundle: Path | None = None
    config: Path | None = None


@dataclass(frozen=True, slots=True)
class Tuned:
    """What is proposed; `diff` is empty where nothing is to change."""

    person: str | None
    motions: tuple[Motion, ...]
    bundle: str
    threshold: Threshold
    profiles: Profiles
    diff: str

    def rows(self) -> list[tuple[str, str, str, str]]:
        """The table for people."""
        return rows_of(self.threshold, self.profiles)

    def as_json(self) -> dict[str, Any]:
        """Plain types."""
        one = self.threshold
        return {
            "person": self.person,
            "recordings": [{"name": m.name, "of": m.said, "files": m.hashes} for m in self.motions],
            "bundle": self.bundle,
            "tau_on": {"old": one.today, "new": one.tau_on, "wished_precision": one.wished, "why": one.why}
            | {"old_curve": _plain(one.before), "new_curve": _plain(one.after)}
            | {"old_own": _plain(one.own_before), "new_own": _plain(one.own_after)},
            "profiles": list(self.profiles.rows),
            "hash": {"old": self.profiles.old_hash, "new": self.profiles.new_hash},
            "diff": self.diff,
        }


def _plain(one: Any) -> dict[str, Any] | None:
    return None if one is None else dict(one._asdict())


def tune(wish: Wish, progress: Callable[[int], Callable[[], None]], say: Say = lambda _: None) -> Tuned:
    """Look at everything before the long part begins. Raises InputError."""
    motions = tuple(motion_of(path) for path in wish.files)
    person = one_person(motions)
    settings = load_config(wish.config)
    path = wish.bundle or (Path(settings.model.bundle) if settings.model.bundle else demo_bundle_path())
    bundle = load_bundle(path)
    today = _today(settings.gate.tau_on, settings.gate.precision, bundle)
    own_at = _own(bundle, wish.files, say)
    threshold = threshold_for(bundle, today, wish.precision, own_at)
    profiles = propose(wish.device, motions, progress)
    diffs = [diff_of((wish.device.profiles or Path(PROFILES)).name, profiles.old_text, profiles.new_text)]
    if threshold.is_change:
        text = "" if wish.config is None else wish.config.read_text(encoding="utf-8-sig")
        name = CONFIG if wish.config is None else wish.config.name
        diffs.append(diff_of(name, text, config_with(text, threshold.tau_on)))
    label = f"{bundle.bundle_id:#06x}"
    diff = to_sign(person, motions, label, profiles, diffs) if any(diffs) else ""
    return Tuned(person, motions, label, threshold, profiles, diff)


def _today(tau_on: float | None, precision: float | None, bundle: Bundle) -> float:
    """As the bridge would choose it."""
    if tau_on is not None:
        return tau_on
    chosen = None if precision is None else bundle.tau_for(precision)
    return bundle.thresholds.tau_on if chosen is None else chosen


def _own(bundle: Bundle, files: Sequence[Path], say: Say) -> Callable[[float], Own] | None:
    """The gate on the labelled ones among the recordings; None where none is, or training is not installed."""
    places = [path for path in files if is_recording(path)]
    if not places:
        return None
    labelled = []
    for place in places:
        try:
            session = recorded_session(place, Naming(bundle.vocabulary, strict=False))
        except InputError as error:  # without features there is a tremor in it all the same
            say(f"{error}; tau_on is chosen without it")
            continue
        if session is not None and session.stream.known.any():
            labelled.append(session.stream)
    if not labelled:
        say("no recording is labelled: tau_on is chosen by the bundle's replay alone (`hilbridge label FILE`)")
        return None
    with needs_extra("train"):
        from hilbridge.learning.training.make_bundle import replay_bundle

    @cache
    def own_at(tau_on: float) -> Own:
        made = [replay_bundle(bundle, stream, tau_on) for stream in labelled]
        judged = sum(int(one.judged.sum()) for one in made)
        right = sum(int(np.sum(one.right[one.judged])) for one in made)
        return Own(judged, right, sum(int(one.known.sum()) for one in made))

    return own_at
