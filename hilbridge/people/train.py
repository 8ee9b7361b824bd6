"""`hilbridge train --data`: sessions of people in, a calibrated bundle, a report and a model card out."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.files import write_whole
from hilbridge.intent.bundle import Bundle, save_bundle
from hilbridge.intent.card import card_of
from hilbridge.intent.provenance import LEAST_PEOPLE, Provenance, digest_of, refusal
from hilbridge.learning.data.people import People
from hilbridge.learning.experiments.people_report import people_sections
from hilbridge.learning.experiments.report import write_report
from hilbridge.learning.training.folds import FoldPlan, train_folds
from hilbridge.learning.training.gate_fit import calibrate
from hilbridge.learning.training.make_bundle import make_bundle, versions
from hilbridge.learning.training.recipes import RECIPES, Recipe
from hilbridge.people.load import load_people
from hilbridge.records import Modality

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class PeopleConfig:
    """data: recordings, folders of them, data sets. out: the bundle; work: folds (an interrupted run goes on from there);
    report: folder of the report and the card. precision: what tau_on must replay to on people not seen."""

    data: tuple[Path, ...]
    out: Path
    work: Path
    report: Path
    recipe_name: str = "best"
    recipe: Recipe | None = None
    precision: float = 0.8
    folds: int = 5
    jobs: int = 1
    cluster: str | None = None


@dataclass(frozen=True, slots=True)
class Made:
    """What training left behind, and what it came to in lines."""

    bundle: Path
    report: Path
    card: Path
    lines: tuple[str, ...]


def train_on_people(config: PeopleConfig, say: Say = lambda _: None) -> Made:
    """Load, train by fold, calibrate out of fold, train on all, write. Raises InputError naming what is wrong."""
    if config.recipe_name not in RECIPES:
        raise InputError(f"--recipe {config.recipe_name}: must be one of {', '.join(RECIPES)}")
    if config.out.is_dir():
        raise InputError(f"--out {config.out}: a folder; name the file of the bundle")
    people = load_people(config.data, say)
    say(
        f"{len(people.names)} people, {len(people.sessions)} sessions, {people.minutes:.1f} labelled minutes, {people.origin}"
    )
    recipe = config.recipe or RECIPES[config.recipe_name]
    plan = FoldPlan(recipe, config.folds, config.recipe_name == "paper", config.jobs, config.cluster)
    key = hashlib.sha256(json.dumps(people.files, sort_keys=True).encode()).hexdigest()
    folded = train_folds(plan, people.stream, key, config.work, say)
    say("calibrating what the gate compares, out of fold")
    try:
        fitted = calibrate(folded.logits, people.stream, folded.losses, people.vocabulary)
    except ValueError as error:
        raise InputError(f"--data: {error}") from None
    record = Provenance(
        people.origin,
        len(people.names),
        round(people.minutes, 3),
        {**asdict(recipe), "name": config.recipe_name, "folds": folded.folds, "epochs_of_all": folded.epochs},
        tuple(digest_of(name) for name in people.names),
        people.files,
        {"curve": "of people out of fold"},
        versions(),
    )
    bundle = make_bundle(folded.final, fitted, config.precision, record, people.vocabulary)
    sections = people_sections(people, folded, fitted, bundle)
    facts = {
        "people": len(people.names),
        "labelled minutes": round(people.minutes, 1),
        "origin": str(people.origin),
        "recipe": config.recipe_name,
        "folds": folded.folds,
        "missing": "; ".join(missing(people, bundle, config.precision)) or "nothing",
    }
    page = write_report(config.report, "hilbridge: bundle of people", sections, facts)
    lines = summary(people, bundle, config.precision)
    card = write_whole(config.report / "model_card.md", card_of(bundle, lines))
    return Made(save_bundle(bundle, config.out), page, card, tuple(lines))


def summary(people: People, bundle: Bundle, precision: float) -> list[str]:
    """What was reached, and what is missing, in lines for a person."""
    chosen = next(point for point in bundle.curve if point.tau_on == bundle.thresholds.tau_on)
    reached = bundle.tau_for(precision) is not None
    return [
        f"tau_on {chosen.tau_on:g}: act-only precision {chosen.precision:.3f} on people out of fold, average person "
        f"{chosen.person_precision:.3f}, coverage {chosen.coverage:.3f}, {chosen.people:g} of {len(people.names)} people act",
        *([] if reached else [f"precision {precision:g} is NOT reached at any threshold on people out of fold"]),
        *(f"missing: {one}" for one in missing(people, bundle, precision)),
    ]


def missing(people: People, bundle: Bundle, precision: float) -> Sequence[str]:
    """What still stands between this bundle and a physical bus."""
    made = []
    if bundle.tau_for(precision) is None:
        made.append(f"a predictor that reaches {precision:g}: more people, more sensors, or ask for less")
    made += [
        f"{modality.name.lower()}: no session has it"
        for modality in Modality
        if not people.stream.valid[:, int(modality)].any()
    ]
    why = refusal(bundle.provenance, bundle.doubt, bundle.thresholds.tau_on)
    if why is not None:
        made.append(
            f"for a physical bus: {why} (`hilbridge certify --data` on others; {LEAST_PEOPLE} people to train on)"
        )
    return made
