"""The model card of a bundle in a few lines: what it was made of, what it may be used for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hilbridge.rows import BundleRow


def card_lines(
    bundle_id: int, tau_on: float, tau_off: float, provenance: Mapping[str, Any] | None, doubt: str | None
) -> list[tuple[str, str]]:
    """Name and value of every line."""
    lines = [
        ("Bundle", f"{bundle_id:04x}"),
        ("Thresholds", f"acts from {100 * tau_on:.3g} %, holds below {100 * tau_off:.3g} %"),
    ]
    if doubt is not None:
        lines.append(("Doubt", doubt))
    if provenance is None:
        return lines
    lines.append(("Trained on", f"{provenance.get('people', '?')} people ({provenance.get('origin', 'unknown')})"))
    if isinstance(provenance.get("minutes"), int | float):
        lines.append(("Data", f"{provenance['minutes']:.0f} min"))
    promise = provenance.get("certificate")
    if isinstance(promise, Mapping):
        text = (
            f"act-only precision of {promise.get('precision', 0):.0%} or more from {promise.get('tau_on', 0):.0%}, "
            f"with {1 - promise.get('delta', 1):.0%} confidence, {promise.get('people')} people ({promise.get('origin')})"
        )
        lines.append(("Certificate", text))
    else:
        lines.append(("Certificate", "none"))
    return lines


def card_of_row(row: BundleRow) -> list[tuple[str, str]]:
    """The card of a recording's bundle."""
    lines = card_lines(row.bundle_id, row.tau_on, row.tau_off, row.provenance, row.doubt)
    return lines if row.intent == "predictor" else [("Beliefs", f"from the {row.intent}"), *lines]
