"""Where a bundle comes from, as a record: origin, people, data, recipe, versions, certificate.

The seal is a hash over everything in the bundle, tensors included, so that no part of it is edited without being seen. It
is no signature: whoever can write a bundle can seal it. It guards against a slip, not against a forger.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

LEAST_PEOPLE = 12  # trained on fewer, a bundle has seen too little of how people differ


class Origin(StrEnum):
    """Whose data a bundle was trained on."""

    SIMULATED = "simulated"
    RECORDED = "recorded people"


@dataclass(frozen=True, slots=True)
class Promise:
    """What was certified: P(`estimand` below `precision`) <= `delta` at `tau_on`, from `people` nobody trained on.

    data: SHA-256 by name of what it stands on; empty for simulated people.
    """

    tau_on: float
    precision: float
    delta: float
    method: str
    estimand: str
    people: int
    origin: Origin
    data: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("tau_on", "precision", "delta"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise ValueError(f"certificate.{name} = {getattr(self, name)}: must be between 0 and 1")
        if not self.method or not self.estimand or self.people < 1:
            raise ValueError("certificate: names no method, no estimand or nobody")


@dataclass(frozen=True, slots=True)
class Provenance:
    """people and minutes: everybody whose data went into weights, calibration or threshold.

    who: a digest of each person's pseudonym, so that nobody is certified on who was trained on; empty where people were made
    from seeds. data: SHA-256 by name of every file read, likewise. recipe, figures: what training was told and what it
    came to. versions: of hilbridge and the libraries.
    """

    origin: Origin
    people: int
    minutes: float
    recipe: Mapping[str, Any]
    who: tuple[str, ...] = ()
    data: Mapping[str, str] = field(default_factory=dict)
    figures: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    certificate: Promise | None = None

    def __post_init__(self) -> None:
        if type(self.people) is not int or self.people < 1 or not self.minutes > 0.0:
            raise ValueError(f"provenance: {self.people!r} people of {self.minutes!r} minutes")
        if self.origin is Origin.RECORDED and (not self.data or len(self.who) != self.people):
            raise ValueError("provenance: recorded people, but no file, or not everybody, is named")

    def as_json(self) -> dict[str, Any]:
        """Plain types."""
        return asdict(self)


def digest_of(person: str) -> str:
    """What a bundle keeps of a pseudonym: enough to know the same one again."""
    return hashlib.sha256(f"hilbridge person {person}".encode()).hexdigest()[:16]


def provenance_of(raw: Any) -> Provenance:
    """The record that a header holds. Raises ValueError, TypeError or KeyError for anything else."""
    if not isinstance(raw, Mapping):
        raise TypeError(f"provenance is {type(raw).__name__}, not an object")
    promise = raw["certificate"]
    return Provenance(
        Origin(raw["origin"]),
        raw["people"],
        float(raw["minutes"]),
        dict(raw["recipe"]),
        tuple(str(digest) for digest in raw["who"]),
        _hashes(raw["data"]),
        dict(raw["figures"]),
        dict(raw["versions"]),
        None if promise is None else _promise(promise),
    )


def _promise(raw: Mapping[str, Any]) -> Promise:
    people = raw["people"]
    if type(people) is not int:
        raise TypeError(f"certificate.people = {people!r}: must be a whole number")
    return Promise(
        float(raw["tau_on"]),
        float(raw["precision"]),
        float(raw["delta"]),
        str(raw["method"]),
        str(raw["estimand"]),
        people,
        Origin(raw["origin"]),
        _hashes(raw["data"]),
    )


def _hashes(raw: Mapping[str, Any]) -> dict[str, str]:
    made = {str(name): str(digest) for name, digest in dict(raw).items()}
    for name, digest in made.items():
        if len(digest) != 64 or not set(digest) <= set("0123456789abcdef"):
            raise ValueError(f"data: {name} has no SHA-256")
    return made


def refusal(record: Provenance | None, doubt: str | None, tau_on: float, *, uncertified: bool = False) -> str | None:
    """Why a bundle may not act on a physical bus with `tau_on`; None where everything affirms that it may.

    doubt: why the record cannot be believed, as loading found. uncertified: a bench asks for it without a certificate.
    """
    if record is None or doubt is not None:
        return doubt or "it has no provenance"
    if record.origin is not Origin.RECORDED:
        return f"trained on {record.origin} people"
    if record.people < LEAST_PEOPLE:
        return f"trained on {record.people} people, at least {LEAST_PEOPLE} are asked for"
    if uncertified:
        return None
    promise = record.certificate
    if promise is None:
        return "its threshold is not certified"
    if promise.origin is not Origin.RECORDED:
        return f"certified on {promise.origin} people"
    if tau_on < promise.tau_on:
        return f"tau_on {tau_on:g} is below {promise.tau_on:g}, which is certified"
    return None
