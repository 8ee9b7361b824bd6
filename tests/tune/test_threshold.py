"""tau_on for one wearer: precise enough by the bundle's replay and by their own, and never lower than today or certified."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.intent.bundle import Bundle, Replayed, demo_bundle_path, load_bundle
from hilbridge.intent.provenance import Origin, Promise, Provenance
from hilbridge.tune.threshold import LEAST_ACTS, Own, threshold_for

LOADED = load_bundle(demo_bundle_path())
CURVE = tuple(
    Replayed(tau_on, precision, coverage, 20.0, precision, 0.1)
    for tau_on, precision, coverage in [
        (0.5, 0.7, 0.5),
        (0.6, 0.8, 0.4),
        (0.7, 0.85, 0.3),
        (0.8, 0.92, 0.2),
        (0.9, 0.97, 0.1),
    ]
)


def bundle(certified: float | None = None, curve: tuple[Replayed, ...] = CURVE, doubt: str | None = None) -> Bundle:
    promise = None
    if certified is not None:
        promise = Promise(certified, 0.8, 0.05, "betting", "precision", 30, Origin.SIMULATED)
    record = Provenance(Origin.SIMULATED, 20, 10.0, {}, certificate=promise)
    return replace(LOADED, curve=curve, provenance=record, doubt=doubt)


def own(**precision_from: float) -> Callable[[float], Own]:
    """A wearer who is right from some tau_on on."""

    def at(tau_on: float) -> Own:
        return Own(100, 95 if tau_on >= precision_from["right_from"] else 60, 1_000)

    return at


def test_the_lowest_that_the_replay_keeps() -> None:
    found = threshold_for(bundle(), 0.6, 0.9)
    assert (found.today, found.tau_on, found.is_change) == (0.6, 0.8, True)
    assert found.before is not None
    assert found.after is not None
    assert (found.before.coverage, found.after.coverage) == (0.4, 0.2)
    assert found.why == "lowest at which the bundle's replay keeps 0.9"
    assert (found.own_before, found.own_after) == (None, None)


@pytest.mark.parametrize(
    ("certified", "today", "wished", "tau_on", "why"),
    [
        (None, 0.7, 0.8, 0.7, "today's"),
        (0.75, 0.7, 0.8, 0.75, "the certified one"),
        (0.75, 0.7, 0.9, 0.8, "lowest at which"),
        (0.75, 0.85, 0.9, 0.85, "today's"),
        (None, 0.7, 0.99, 0.7, "the bundle's replay reaches 0.99 nowhere; today's stays"),
        (0.75, 0.7, 0.99, 0.75, "the bundle's replay reaches 0.99 nowhere; the certified one stays"),
        (None, 0.8, 0.9, 0.8, "today's"),
    ],
)
def test_h1_it_never_falls_below_todays_nor_the_certified_one(
    certified: float | None, today: float, wished: float, tau_on: float, why: str
) -> None:
    found = threshold_for(bundle(certified), today, wished)
    assert found.tau_on == tau_on
    assert found.why.startswith(why)


def test_a_certificate_in_doubt_is_none() -> None:
    assert threshold_for(bundle(0.9, doubt="edited"), 0.7, 0.8).tau_on == 0.7


def test_a_wearer_for_whom_it_is_not_precise_enough_gets_a_higher_one() -> None:
    found = threshold_for(bundle(), 0.6, 0.8, own(right_from=0.75))
    assert (found.tau_on, found.why) == (0.8, "lowest at which this wearer's own recordings keep 0.8")
    assert found.own_before == Own(100, 60, 1_000)
    assert found.own_after == Own(100, 95, 1_000)
    found = threshold_for(bundle(), 0.6, 0.8, own(right_from=0.5))
    assert (found.tau_on, found.why) == (0.6, "today's")
    found = threshold_for(bundle(), 0.6, 0.8, own(right_from=1.0))
    assert (found.tau_on, found.why) == (0.6, "today's; this wearer's own recordings keep 0.8 nowhere")


def test_too_little_of_ones_own_says_nothing() -> None:
    assert Own(LEAST_ACTS - 1, 0, 100).precision is None
    assert Own(LEAST_ACTS, LEAST_ACTS, 100).precision == 1.0
    assert threshold_for(bundle(), 0.6, 0.8, lambda tau_on: Own(3, 0, 100)).tau_on == 0.6

    def fades(tau_on: float) -> Own:
        return Own(100, 10, 1_000) if tau_on < 0.65 else Own(3, 3, 1_000)

    assert threshold_for(bundle(), 0.6, 0.8, fades).tau_on == 0.6


def test_a_curve_that_ends_below_today() -> None:
    found = threshold_for(bundle(curve=CURVE[:2]), 0.9, 0.7)
    assert (found.tau_on, found.before, found.after) == (0.9, None, None)


@given(
    st.floats(0.02, 0.99),
    st.none() | st.floats(0.02, 0.99),
    st.floats(0.01, 0.99),
    st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)), max_size=8),
    st.none() | st.floats(0.0, 1.0),
)
def test_h1_whatever_is_found_the_threshold_only_rises(
    today: float, certified: float | None, wished: float, points: list[tuple[float, float]], from_on: float | None
) -> None:
    curve = tuple(
        Replayed((number + 1) / 10, precision, coverage, 9.0, precision, 0.1)
        for number, (precision, coverage) in enumerate(points)
    )
    own_at = None if from_on is None else own(right_from=from_on)
    found = threshold_for(bundle(certified, curve), today, wished, own_at)
    assert found.tau_on >= today
    assert certified is None or found.tau_on >= certified
    assert found.tau_on <= 1.0
