"""hilbridge.intent.card: a bundle says in words what it was made of, and what keeps it from a physical bus."""

from __future__ import annotations

from dataclasses import replace

from hilbridge.intent.bundle import demo_bundle_path, load_bundle
from hilbridge.intent.card import card_of
from hilbridge.intent.provenance import Origin, Promise

BUNDLE = load_bundle(demo_bundle_path())


def test_the_bundle_that_ships_says_that_it_is_of_simulated_people_and_may_not_act() -> None:
    card = card_of(BUNDLE)
    assert f"{BUNDLE.bundle_id:#06x}" in card
    assert "origin: simulated, " in card
    assert "**On a physical bus: refused, " in card
    assert "certificate: none" in card
    assert "## The simulated wearers" in card


def test_every_point_of_the_replayed_curve_is_in_its_table() -> None:
    rows = [line for line in card_of(BUNDLE).splitlines() if line.startswith("| 0.")]
    assert len(rows) == len(BUNDLE.curve)
    assert rows[0].startswith(f"| {BUNDLE.curve[0].tau_on:g} | {BUNDLE.curve[0].precision:.3f} |")


def test_one_that_is_certified_on_people_says_so_and_may_act() -> None:
    record = BUNDLE.provenance
    assert record is not None
    tau_on = BUNDLE.thresholds.tau_on
    promise = Promise(tau_on, 0.8, 0.05, "betting", "average person", 40, Origin.RECORDED, {"a.mcap": "0" * 64})
    who = tuple(f"{number:016x}" for number in range(20))
    people = replace(record, origin=Origin.RECORDED, people=20, who=who, data={"b.mcap": "1" * 64}, certificate=promise)
    card = card_of(replace(BUNDLE, provenance=people))
    assert "it may act" in card
    assert "P(average person below 0.8) at most 0.05" in card
    assert "The simulated wearers" not in card


def test_one_without_a_record_says_why() -> None:
    card = card_of(replace(BUNDLE, provenance=None, doubt="the seal does not fit"), ["found by hand"])
    assert "origin: unknown (the seal does not fit)" in card
    assert "- found by hand" in card
    assert "refused" in card
