"""The same dropouts on a kernel bus, twenty times each at random phases: H2, H8, H9."""

from __future__ import annotations

import random
from collections.abc import Iterator

import pytest

from tests.system.rig import LIMIT_MS, PROCESS_FAULTS, SENSOR_FAULTS, Rig

REPEATS = 20

pytestmark = [pytest.mark.vcan, pytest.mark.timeout(900)]


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    made = Rig("vcan0", tmp_path_factory.mktemp("rig"))
    try:
        made.start_bridge()
        yield made
    finally:
        made.close()


@pytest.mark.parametrize("fault", [*SENSOR_FAULTS, *PROCESS_FAULTS])
def test_h2_h8_dropout_ends_in_follow_with_zero_assist_on_vcan(rig: Rig, fault: str) -> None:
    chance = random.Random(fault)
    zeros: list[int] = []
    follows: list[int] = []
    while len(follows) < REPEATS and len(zeros) < 2 * REPEATS:
        zero_ms, follow_ms = rig.measure(fault, chance)
        zeros.append(zero_ms)
        if follow_ms is not None:
            follows.append(follow_ms)
    print(
        f"\n{fault}: worst zero assist {max(zeros)} ms of {len(zeros)}, worst FOLLOW {max(follows)} ms of {len(follows)}"
    )
    assert max(zeros) <= LIMIT_MS, zeros
    assert len(follows) == REPEATS
    assert max(follows) <= LIMIT_MS, follows
