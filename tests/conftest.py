"""What every room's tests share: where the real input is, and that CI may not do without it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real input that HILBRIDGE_TEST_DATA names. Absent: the test skips, saying so; in CI it fails."""
    folder = os.environ.get("HILBRIDGE_TEST_DATA")
    if folder and Path(folder).is_dir():
        return Path(folder).resolve()
    message = f"HILBRIDGE_TEST_DATA names no folder ({folder or 'unset'}): real input is not here"
    if os.environ.get("CI"):
        pytest.fail(message)
    pytest.skip(message)
