"""One person's intercept: found when people differ, nothing when they do not, and never the wrong way."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch")

from hilbridge.confidence import ConfidenceMaps, RisingMap
from hilbridge.learning.training.person import Actions, fit_spread, posterior, shifted


def person(intercept: float, count: int, rng: np.random.Generator) -> Actions:
    confidence = rng.uniform(0.6, 0.95, size=count)
    chance = 1.0 / (1.0 + np.exp(-(np.log(confidence / (1.0 - confidence)) + intercept)))
    return Actions(confidence, rng.uniform(size=count) < chance)


def test_the_spread_over_people_is_found() -> None:
    rng = np.random.default_rng(0)
    alike = [person(0.0, 40, rng) for _ in range(80)]
    differ = [person(float(rng.normal(0.0, 0.9)), 40, rng) for _ in range(80)]
    assert fit_spread(alike) <= 0.3
    assert fit_spread(differ) == pytest.approx(0.9, abs=0.3)
    assert fit_spread(alike[:1]) == 0.0


def test_little_evidence_leans_on_everybody_and_much_on_the_person() -> None:
    rng = np.random.default_rng(1)
    assert posterior(Actions(np.array([]), np.array([], dtype=bool)), 0.8)[0] == pytest.approx(0.0, abs=1e-9)
    few, many = posterior(person(-1.5, 3, rng), 0.8), posterior(person(-1.5, 400, rng), 0.8)
    assert abs(few[0]) < abs(many[0])
    assert many[0] == pytest.approx(-1.5, abs=0.3)
    assert many[1] < few[1]
    assert posterior(person(-1.5, 400, rng), 0.0) == (0.0, 0.0)


def test_a_shift_moves_every_confidence_one_way_and_leaves_nothing_at_nothing() -> None:
    maps = ConfidenceMaps({7: RisingMap((0.0, 0.5, 1.0), (0.0, 0.5, 0.9))})
    lower = shifted(maps, -1.0).by_condition[7].y
    assert lower[0] == 0.0
    assert 0.0 < lower[1] < 0.5
    assert lower[1] < lower[2] < 0.9
    assert shifted(maps, 0.0).by_condition[7].y == pytest.approx((0.0, 0.5, 0.9))
