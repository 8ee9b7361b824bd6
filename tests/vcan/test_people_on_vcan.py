"""`run --arm` on a kernel bus with a bundle that says it is of people.

What comes before, from recordings to the certificate, is in
tests/system/test_people_on_the_bus.py: training takes too long in here.
"""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch")

from tests.people.before_a_camera import as_of_people
from tests.system.test_people_on_the_bus import armed_run, assert_of_people

pytestmark = [pytest.mark.vcan, pytest.mark.timeout(1400)]


def test_a_bundle_of_people_arms_a_device_on_a_kernel_bus(tmp_path: Path) -> None:
    assert_of_people(*armed_run(tmp_path, as_of_people(tmp_path / "bundle"), "vcan0"))
