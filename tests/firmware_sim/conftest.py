"""Every test here that steps a controller runs over both: the reference, and the C where it was built.

HILBRIDGE_TESTED=python leaves the C out: for mutants of the reference, which the C cannot show.
"""

from __future__ import annotations

import os

import pytest

from firmware_sim import controllers
from firmware_sim.c import binding

_STEPPING = {"Hand", "Rig", "make", "Device", "Node"}


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """One row a controller for whatever uses one."""
    if not _STEPPING & set(vars(metafunc.module)):
        return
    rows = ["python", "c"]
    if os.environ.get("HILBRIDGE_TESTED") == "python" or not binding.available():
        rows = ["python"]
    metafunc.parametrize("controller", rows, indirect=True)


@pytest.fixture(autouse=True)  # no test asks for it by name, and one that is not asked for is never run
def controller(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Which controller steps in this test; states are the reference's in both."""
    asked = str(getattr(request, "param", "python"))
    if asked == "c":
        monkeypatch.setattr(controllers, "advance", binding.advance_in_c)
    return asked
