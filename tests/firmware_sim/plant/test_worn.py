"""The worn arm against MuJoCo, and what any arm has to do."""

from __future__ import annotations

from math import cos, degrees, pi, sin

import pytest

from firmware_sim.plant.parameters import PRESETS, TABLE
from firmware_sim.plant.worn import LIMP, Muscle, WornArm

mujoco_twin = pytest.importorskip("tests.firmware_sim.plant.mujoco_twin", reason="MuJoCo is not installed")
WITHIN_DEG = 0.2
CASES = [(None, None), *((name, cuff) for name in PRESETS for cuff in (80.0, 300.0, 1000.0))]


def apart(name: str | None, cuff: float | None, driven: bool) -> float:
    """The largest difference of any joint over 2 s, degrees."""
    preset, worst = None if name is None else PRESETS[name], 0.0
    arm, twin = WornArm(preset, cuff, angle=(0.9, 1.2)), mujoco_twin.Twin(preset, (0.9, 1.2), cuff)
    for now_ms in range(2_000):
        t_s = now_ms * 0.001
        own = (3.0 * sin(2 * pi * 0.7 * t_s), 1.5 * cos(2 * pi * 5.0 * t_s)) if driven else (0.0, 0.0)
        motor = (1.0, 2.0 * sin(2 * pi * 1.1 * t_s)) if driven else (0.0, 0.0)
        arm.step(motor, (Muscle(own[0]), Muscle(own[1])))
        twin.step((*own, *motor))
        mine = (*arm.angle, *arm.device_angle)[: twin.model.nq]
        worst = max(worst, *(abs(here - there) for here, there in zip(mine, twin.data.qpos, strict=True)))
    return degrees(worst)


@pytest.mark.parametrize("driven", [False, True])
@pytest.mark.parametrize(("name", "cuff"), CASES)
def test_two_seconds_beside_mujoco(name: str | None, cuff: float | None, driven: bool) -> None:
    assert apart(name, cuff, driven) <= WITHIN_DEG


@pytest.mark.parametrize("name", [None, *PRESETS])
def test_a_limp_arm_only_loses_energy(name: str | None) -> None:
    arm = WornArm(None if name is None else PRESETS[name], angle=(1.2, 1.5))
    before = arm.energy_j()
    for _ in range(3_000):
        arm.step((0.0, 0.0), LIMP)
        assert arm.energy_j() <= before + 2e-3  # the integrator's own ripple
        before = min(before, arm.energy_j())


def test_the_hand_is_straight_below_a_hanging_arm() -> None:
    assert WornArm(angle=(0.0, 0.0)).hand() == pytest.approx((0.0, -0.64))


def test_each_number_has_a_unit_and_a_source() -> None:
    assert all(one.unit and one.source for one in TABLE.values())
