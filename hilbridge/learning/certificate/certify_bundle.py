"""What the command line calls that is no room of its own: certification of a bundle's threshold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hilbridge.core.gate import GateConfig
from hilbridge.intent.bundle import Bundle, Thresholds, load_bundle, save_bundle
from hilbridge.intent.calibration import ALL_VALID
from hilbridge.learning.certificate.certify import Certificate, Counts, Method, RegionBound, certify, region_bound
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.synthetic import record_people
from hilbridge.learning.data.windows import Statistics
from hilbridge.learning.training.make_bundle import DIFFICULTIES, TAU_BAND
from hilbridge.learning.training.replay import estimates, replay, stream_logits
from hilbridge.records import IntentEstimate

GATE_TAUS: tuple[float, ...] = tuple(round(0.95 - 0.05 * step, 2) for step in range(16))
CERTIFY_SEED = 20_000


@dataclass(frozen=True, slots=True)
class CertifyConfig:
    """bundle: whose threshold; precision, delta: the promise; people simulated wearers of `seconds` each, from seeds that
    no training uses; write: where to put the bundle with the certified threshold (None: nowhere)."""

    bundle: Path
    precision: float = 0.8
    delta: float = 0.05
    method: Method = Method.BETTING
    wearer: str = "demo"
    people: int = 200
    seconds: float = 40.0
    cache: Path | None = None
    write: Path | None = None


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

    A window is a 25 Hz step, a cluster is a person. The promise holds for people like those simulated. Raises BundleError
    or ValueError naming what is wrong.
    """
    if config.wearer not in DIFFICULTIES:
        raise ValueError(f"wearer {config.wearer!r}: must be one of {', '.join(DIFFICULTIES)}")
    if config.write is not None and config.method is Method.CLOPPER_PEARSON:
        raise ValueError(
            "clopper_pearson is for comparison only and is not written into a bundle; use betting or cluster_t"
        )
    bundle = load_bundle(config.bundle)
    seeds = range(CERTIFY_SEED, CERTIFY_SEED + config.people)
    people = record_people(seeds, DIFFICULTIES[config.wearer], config.seconds, config.cache, progress)
    logits = stream_logits(bundle.weights, people, Statistics(bundle.mean, bundle.std))
    beliefs = estimates(logits, bundle.calibration, ALL_VALID)
    counts = gate_counts(beliefs, people)
    certificate = certify(counts, config.precision, config.delta, config.method)
    spoken = [index for index, belief in enumerate(beliefs) if belief is not None]
    confidence = np.array([belief.confidence for belief in beliefs if belief is not None])
    top = np.array([belief.verb_index for belief in beliefs if belief is not None])
    bound = region_bound(confidence, top == people.label[spoken], certificate.tau_on or bundle.thresholds.tau_on)
    written = None
    if config.write is not None and certificate.tau_on is not None:
        written = save_bundle(_with_threshold(bundle, certificate), config.write)
    return Certified(certificate, bound, written)


def gate_counts(beliefs: list[IntentEstimate | None], people: Stream) -> Counts:
    """Acting and wrong steps per candidate tau_on and person, from replaying the gate at each."""
    names, place = np.unique(people.subject, return_inverse=True)
    acting, wrong = [], []
    for tau in GATE_TAUS:
        result = replay(GateConfig(tau_on=tau, tau_off=max(0.02, tau - TAU_BAND)), beliefs, people)
        acting.append(np.bincount(place, weights=result.acting, minlength=len(names)))
        wrong.append(np.bincount(place, weights=result.acting & ~result.right, minlength=len(names)))
    return Counts(GATE_TAUS, np.array(acting, dtype=np.int64), np.array(wrong, dtype=np.int64), np.bincount(place))


def _with_threshold(bundle: Bundle, certificate: Certificate) -> Bundle:
    assert certificate.tau_on is not None
    promise = {
        "precision": certificate.precision,
        "delta": certificate.delta,
        "method": str(certificate.method),
        "clusters": certificate.clusters,
    }
    thresholds = Thresholds(certificate.tau_on, max(0.02, round(certificate.tau_on - TAU_BAND, 3)))
    return replace(bundle, thresholds=thresholds, provenance={**bundle.provenance, "certificate": promise})


def method_named(name: str) -> Method:
    """The method of that name. Raises ValueError naming those there are."""
    if name not in list(Method):
        raise ValueError(f"method {name!r}: must be one of {', '.join(Method)}")
    return Method(name)
