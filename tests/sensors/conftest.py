from __future__ import annotations

from pathlib import Path

import pytest

from hilbridge.sensors import models


@pytest.fixture(scope="session")
def hand_model() -> Path:
    """The model, fetched once into the user's data folder as a user would."""
    return models.fetch_hand_model(models.hand_model_path())
