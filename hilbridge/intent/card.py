"""What a bundle says of itself, in words: for whom it was made, on what, what was reached, and whether it may act. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from hilbridge.intent.bundle import Bundle, Replayed
from hilbridge.intent.provenance import Origin, Provenance, refusal

_WEARERS = """## The simulated wearers

People made from seeds: sequences of verbs, their durations and pauses follow aggregated statistics of EGTEA Gaze+'s published
annotations (`hilbridge/wearer/statistics.json`; 32 subjects, no recording of any of them is in this project). Gaze goes to the
object of the next action before the hand does, and the scene's colours say which one it is, so the next verb can be seen: real
people are harder. Tremor, lost hands and blinks are drawn from the seed as well.
"""


def card_of(bundle: Bundle, found: Sequence[str] = ()) -> str:
    """A model card in Markdown. found: what those who made it want to say beside it."""
    record = bundle.provenance
    why = refusal(record, bundle.doubt, bundle.thresholds.tau_on)
    lines = [
        f"# Model card of bundle {bundle.bundle_id:#06x}" if bundle.bundle_id else "# Model card",
        "Predicts the next verb of a wearer from gaze, hands and scene, for `hilbridge run`. Not for people unlike those it "
        "was made from: people who tremble otherwise, use other objects, or are recorded by other sensors may differ.",
        "\n".join(f"- {line}" for line in (*_facts(bundle, record), *found)),
        f"**On a physical bus: {'it may act' if why is None else f'refused, {why}'}.**",
        "## What the gate comes to on people that nothing was fitted on",
        _curve(bundle.curve),
    ]
    if record is not None and record.origin is Origin.SIMULATED:
        lines.append(_WEARERS)
    return "\n\n".join(lines) + "\n"


def _facts(bundle: Bundle, record: Provenance | None) -> list[str]:
    size = f"GRU of {bundle.weights.hidden_weight.shape[1]} units, a window of {bundle.window_steps} steps of 40 ms"
    gate = f"tau_on {bundle.thresholds.tau_on:g}, tau_off {bundle.thresholds.tau_off:g}"
    verbs = bundle.vocabulary
    held = [name for name in verbs.names if name not in verbs.assisted]
    size += f"; {len(verbs)} verbs: {', '.join(verbs.names)}; never assisted: {', '.join(held) or 'none of them'}"
    if record is None:
        return [size, gate, f"origin: unknown ({bundle.doubt or 'the file does not say'})"]
    promise = record.certificate
    kept = (
        "none"
        if promise is None
        else (
            f"{promise.method}: P({promise.estimand} below {promise.precision:g}) at most {promise.delta:g} at tau_on "
            f"{promise.tau_on:g}, on {promise.people} people ({promise.origin})"
        )
    )
    return [
        size,
        gate,
        f"origin: {record.origin}, {record.people} people, {record.minutes:.1f} minutes",
        f"data: {len(record.data)} files, their hashes are in the bundle" if record.data else "data: made from seeds",
        f"recipe: {', '.join(f'{name} {value}' for name, value in sorted(record.recipe.items()))}",
        f"versions: {', '.join(f'{name} {value}' for name, value in sorted(record.versions.items()))}",
        f"certificate: {kept}",
    ]


def _curve(curve: Sequence[Replayed]) -> str:
    rows = [
        f"| {at.tau_on:g} | {at.precision:.3f} | {at.person_precision:.3f} ({at.person_spread:.3f}) | {at.coverage:.3f} "
        f"| {at.people:g} |"
        for at in curve
    ]
    head = "| tau_on | act-only precision, all ticks | average person (deviation) | coverage | people who act |"
    return "\n".join([head, "|---|---|---|---|---|", *rows])
