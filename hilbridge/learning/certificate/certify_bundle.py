"""`hilbridge certify`: a bundle's threshold, certified through its gate on people that nothing was fitted on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from hilbridge.cluster import run_all, workers
from hilbridge.core.gate import GateConfig
from hilbridge.intent.bundle import Bundle, load_bundle, save_bundle
from hilbridge.intent.provenance import Origin, Promise
from hilbridge.learning.certificate.certify import Certificate, Counts, Method, RegionBound, certify, region_bound
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.synthetic import record_people
from hilbridge.learning.data.windows import Statistics
from hilbridge.learning.training.gate_fit import TAU_BAND, TAUS
from hilbridge.learning.training.make_bundle import DIFFICULTIES, gate_of, thresholds_at
from hilbridge.learning.training.replay import (
    Floats,
    Ints,
    Watched,
    conditions,
    mapped,
    replay,
    stream_logits,
    watch,
    with_taus,
)

GATE_TAUS = tuple(reversed(TAUS))
CERTIFY_SEED = 20_000


@dataclass(frozen=True, slots=True)
class CertifyConfig:
    """bundle: whose threshold; precision, delta: the promise; people simulated wearers of `seconds` each, from seeds that
    no training uses; write: where to put the bundle with the certified threshold (None: nowhere);
    jobs, cluster: where it is computed, by person (`hilbridge.cluster`)."""

    bundle: Path
    precision: float = 0.8
    delta: float = 0.05
    method: Method = Method.BETTING
    wearer: str = "demo"
    people: int = 200
    seconds: float = 40.0
    cache: Path | None = None
    write: Path | None = None
    jobs: int = 1
    cluster: str | None = None


@dataclass(frozen=True, slots=True)
class Certified:
    """The certificate, the paper's region bound at the same tau, and the bundle written (if any)."""

    certificate: Certificate
    bound: RegionBound | None
    written: Path | None

    def lines(self) -> list[str]:
        """For people."""
        made = self.certificate.lines()
        made += self.bound.lines() if self.bound is not None else []
        made += [f"written to {self.written}"] if self.written is not None else []
        return made


def certify_bundle(config: CertifyConfig, progress: Callable[[], None] = lambda: None) -> Certified:
    """Certify act-only precision of the whole chain, the gate's smoothing and hysteresis included.

    The promise holds for people like those simulated. Raises BundleError or ValueError naming what is wrong.
    """
    if config.wearer not in DIFFICULTIES:
        raise ValueError(f"wearer {config.wearer!r}: must be one of {', '.join(DIFFICULTIES)}")
    check_writable(config)
    bundle = load_bundle(config.bundle)
    seeds = range(CERTIFY_SEED, CERTIFY_SEED + config.people)
    people = record_people(seeds, DIFFICULTIES[config.wearer], config.seconds, config.cache, progress)
    return certify_on(config, bundle, people, Origin.SIMULATED, {})


def check_writable(config: CertifyConfig) -> None:
    """Raises ValueError for a method that is not to be relied on."""
    if config.write is not None and config.method is Method.CLOPPER_PEARSON:
        raise ValueError("clopper_pearson is for comparison only and is not written into a bundle; use betting")


def certify_on(
    config: CertifyConfig, bundle: Bundle, people: Stream, origin: Origin, data: dict[str, str]
) -> Certified:
    """Certify on these people, who must be nobody that the bundle was trained or calibrated on."""
    logits, under = _by_person(config, bundle, people)
    gate = gate_of(bundle)
    seen = watch(logits, under, people.subject, bundle.temperatures, gate)
    counts = gate_counts(gate, seen, people)
    certificate = certify(counts, config.precision, config.delta, config.method, start_of(bundle, config.precision))
    judged = seen.able & people.known
    confidence = mapped(bundle.maps, seen.probability, seen.condition)[judged]
    right = people.right(seen.candidate)[judged]
    bound = region_bound(confidence, right, certificate.tau_on or bundle.thresholds.tau_on)
    written = None
    if config.write is not None and certificate.tau_on is not None:
        written = save_bundle(_with_threshold(bundle, certificate, origin, data), config.write)
    return Certified(certificate, bound, written)


def _by_person(config: CertifyConfig, bundle: Bundle, people: Stream) -> tuple[Floats, Ints]:
    """Logits and condition of each step; who comes first in the stream comes first."""
    edges = np.flatnonzero(np.r_[True, people.subject[1:] != people.subject[:-1], True])
    at = np.arange(len(people))
    parts = [(bundle, people.part((at >= start) & (at < stop))) for start, stop in pairwise(edges.tolist())]
    with workers(config.jobs, config.cluster) as pools:
        made = run_all(pools, _of_person, parts, "certify")
    return np.concatenate([logits for logits, _ in made]), np.concatenate([under for _, under in made])


def _of_person(bundle: Bundle, person: Stream) -> tuple[Floats, Ints]:
    return stream_logits(bundle.weights, person, Statistics(bundle.mean, bundle.std)), conditions(person)


def gate_counts(gate: GateConfig, seen: Watched, people: Stream) -> Counts:
    """Acting and wrong steps per candidate tau_on and person, of those whose truth is known, from replaying the gate."""
    names, place = np.unique(people.subject, return_inverse=True)
    acting, wrong = [], []
    for tau in GATE_TAUS:
        done = replay(with_taus(gate, tau, TAU_BAND), seen, people)
        acting.append(np.bincount(place, weights=done.judged, minlength=len(names)))
        wrong.append(np.bincount(place, weights=done.judged & ~done.right, minlength=len(names)))
    total = np.bincount(place, weights=people.known, minlength=len(names)).astype(np.int64)
    return Counts(GATE_TAUS, np.array(acting, dtype=np.int64), np.array(wrong, dtype=np.int64), total)


def start_of(bundle: Bundle, precision: float) -> float:
    """Where the people that the bundle was calibrated on would begin; they are not tested.

    By their mean and spread, and by how many of them act: a handful who do well at a strict tau are no sign for others.
    """
    best = max(
        bundle.curve,
        key=lambda point: (point.person_precision - precision) * point.people / max(point.person_spread, 0.1),
        default=None,
    )
    return GATE_TAUS[0] if best is None else best.tau_on


def _with_threshold(bundle: Bundle, certificate: Certificate, origin: Origin, data: dict[str, str]) -> Bundle:
    """The bundle with its certified threshold; one without a record that can be believed gets none by being certified."""
    assert certificate.tau_on is not None
    promise = Promise(
        certificate.tau_on,
        certificate.precision,
        certificate.delta,
        str(certificate.method),
        certificate.estimand,
        certificate.clusters,
        origin,
        data,
    )
    record = None
    if bundle.provenance is not None and bundle.doubt is None:
        record = replace(bundle.provenance, certificate=promise)
    return replace(bundle, thresholds=thresholds_at(certificate.tau_on), provenance=record)


def method_named(name: str) -> Method:
    """The method of that name. Raises ValueError naming those there are."""
    if name not in list(Method):
        raise ValueError(f"method {name!r}: must be one of {', '.join(Method)}")
    return Method(name)
