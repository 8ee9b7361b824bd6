from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture
def egtea(data: Path) -> Path:
    """The real annotations and gaze."""
    return data / "egtea"
