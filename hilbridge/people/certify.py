"""`hilbridge certify --data`: a certificate on recorded people whom the bundle has never met."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.intent.bundle import load_bundle
from hilbridge.intent.provenance import digest_of
from hilbridge.learning.certificate.certify_bundle import Certified, CertifyConfig, certify_on, check_writable
from hilbridge.people.load import load_people


def certify_on_people(config: CertifyConfig, data: Sequence[Path], say: Callable[[str], None]) -> Certified:
    """Certify on everybody under `data`. Raises InputError for a file that the bundle was trained on, or ValueError."""
    check_writable(config)
    bundle = load_bundle(config.bundle)
    people = load_people(data, say, bundle.vocabulary)
    met = set() if bundle.provenance is None else set(bundle.provenance.who)
    again = [name for name in people.names if digest_of(name) in met]
    if again:
        raise InputError(f"--data: the bundle was trained on {again[0]}; certify on people whom it has never met")
    say(f"{len(people.names)} people, {len(people.sessions)} sessions, {people.minutes:.1f} labelled minutes")
    return certify_on(config, bundle, people.stream, people.origin, people.files)
