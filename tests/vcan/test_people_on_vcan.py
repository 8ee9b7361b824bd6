"""The whole way from recordings of people to `run --arm`, on a kernel bus."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch")

from tests.system.test_people_on_the_bus import armed_run, assert_of_people

pytestmark = [pytest.mark.vcan, pytest.mark.timeout(1400)]


def test_a_bundle_of_people_arms_a_device_on_a_kernel_bus(tmp_path: Path) -> None:
    assert_of_people(*armed_run(tmp_path, "vcan0"))
