"""Bridge and device as processes on the simulated bus: every dropout ends the assist in time (H2, H8, H9)."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.rig import LIMIT_MS, PROCESS_FAULTS, SENSOR_FAULTS, Rig


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    folder: Path = tmp_path_factory.mktemp("rig")
    made = Rig(f"hilsim:dropouts-{os.getpid()}", folder)
    try:
        made.start_bridge()
        yield made
    finally:
        made.close()


@pytest.mark.parametrize("fault", [*SENSOR_FAULTS, *PROCESS_FAULTS])
def test_h2_h8_dropout_ends_in_follow_with_zero_assist(rig: Rig, fault: str) -> None:
    chance = random.Random(fault)
    followed = 0
    for _ in range(8):
        zero_ms, follow_ms = rig.measure(fault, chance)
        assert zero_ms <= LIMIT_MS
        if follow_ms is not None:
            assert follow_ms <= LIMIT_MS
            followed += 1
        if followed == 2:
            return
    raise AssertionError(f"the device came to FOLLOW in {followed} of 8 repeats")
