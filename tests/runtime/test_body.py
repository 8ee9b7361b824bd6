"""runtime.body: what inertial sensors and a skeleton say reaches guard, hands, health and recording."""

from __future__ import annotations

import math
from typing import Any

import pytest

from hilbridge.config import SensorsConfig
from hilbridge.errors import InputError
from hilbridge.features.wrists import projection_of
from hilbridge.limits import MS
from hilbridge.records import BodySample
from hilbridge.rows import InertialRow, SkeletonRow
from hilbridge.runtime.body import BodySenses, body_projection, open_body
from hilbridge.runtime.health import first_problem
from hilbridge.sensors.source import SourceState
from tests.runtime.test_senses import Told

PLAIN = [1.0, 0.0, 0.5, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0, 0.0]
LIMITS = SensorsConfig()


def give(source: Any, sample: BodySample) -> None:
    source.cell.put(sample)
    source.on_value(sample)


def test_without_either_nothing_is_said() -> None:
    body = BodySenses()
    assert (body.seen(LIMITS), body.sources, body.felt, body.wrists, body.ended) == ((), {}, None, None, False)


def test_h9_inertial_sensors_that_say_nothing_are_a_reason_to_hold() -> None:
    inertial = Told("inertial", [])
    body = BodySenses(inertial)
    assert first_problem(body.seen(LIMITS), 1000 * MS) == "inertial has not delivered yet"
    give(inertial, BodySample(1000 * MS, "FOREARM", 0.0, 0.0, 9.81))  # on no hand
    assert first_problem(body.seen(LIMITS), 1000 * MS) == "inertial has not delivered yet"
    give(inertial, BodySample(1000 * MS, "HAND", 0.0, 0.0, 9.81))
    assert first_problem(body.seen(LIMITS), 1100 * MS) is None
    give(inertial, BodySample(1130 * MS, "HAND", 0.0, 0.0, 9.81, valid=False))
    assert first_problem(body.seen(LIMITS), 1130 * MS) == "inertial silent for more than 120 ms"
    inertial.state = SourceState.GONE
    assert first_problem(body.seen(LIMITS), 1000 * MS) == "inertial is gone"


def test_a_tremor_that_is_felt_is_told_and_each_sample_is_accounted_for() -> None:
    inertial, told = Told("inertial", []), []
    body = BodySenses(inertial)
    body.on_sample = lambda kind, sample: told.append((kind, sample.sensor))
    for number in range(200):
        give(inertial, BodySample(number * 10 * MS, "HAND", 3 * math.sin(number * 0.5), 0.0, 9.81))
    assert body.felt is not None
    assert body.felt.trembling
    assert told == [(InertialRow, "HAND")] * 200
    counts = inertial.cell.counts()
    assert (counts.used, counts.overwritten) == (200, 0)


def test_a_silent_skeleton_is_no_reason_to_hold() -> None:
    skeleton, told = Told("skeleton", []), []
    body = BodySenses(None, skeleton, projection_of(PLAIN))
    body.on_sample = lambda kind, sample: told.append(kind)
    assert body.seen(LIMITS) == ()
    give(skeleton, BodySample(1000 * MS, "RIGHT_WRIST", 0.0, 0.0, 1.0))
    assert body.wrists is not None
    assert body.wrists.hands_at(1000 * MS) is not None
    assert told == [SkeletonRow]
    skeleton.state = SourceState.ENDED
    assert body.ended


def test_a_skeleton_without_a_projection_is_refused() -> None:
    assert body_projection(SensorsConfig()) is None
    with pytest.raises(InputError, match="set skeleton_projection"):
        body_projection(SensorsConfig(skeleton="udp:7001"))
    assert body_projection(SensorsConfig(skeleton="udp:7001", skeleton_projection=PLAIN)) is not None


@pytest.mark.parametrize("spec", ["neon:", "udp:x", "/no/such/folder"])
def test_what_is_no_such_source_is_one_line(spec: str) -> None:
    with pytest.raises(InputError, match=f"inertial {spec}"):
        open_body("inertial", spec)
