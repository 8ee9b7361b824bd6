"""hilbridge.api: what is public is on its page, and the core can be stepped without a bridge around it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from hilbridge import api
from hilbridge.limits import MS

PAGE = Path(__file__).parents[2] / "docs" / "api.md"


def vector(at_ms: int) -> api.FeatureVector:
    values = np.zeros(api.D, np.float32)
    return api.FeatureVector(at_ms * MS, at_ms * MS, values, (True, True, True))


def test_every_public_name_is_on_the_page_and_is_there() -> None:
    page = PAGE.read_text(encoding="utf-8")
    named = set(re.findall(r"\b\w+\b", page))
    assert [name for name in api.__all__ if name not in named] == ["Step"]  # what `step` gives
    assert all(hasattr(api, name) for name in api.__all__)


def test_the_page_names_nothing_that_is_not_there() -> None:
    for row in PAGE.read_text(encoding="utf-8").splitlines():
        for module, name in re.findall(
            r"`(hil\w+(?:\.\w+)+)\.(\w+)`", row.split("|")[1] if row.startswith("|") else ""
        ):
            assert hasattr(__import__(module, fromlist=[name]), name), f"{module}.{name}"


def test_the_core_holds_until_it_has_seen_enough() -> None:
    stepper = api.Stepper()
    said = [stepper.step(vector(40 * tick), 40 * tick * MS) for tick in range(1, 80)]
    assert said[0].decision.reason is api.HoldReason.WARMING_UP
    assert said[0].estimate is None
    assert said[-1].estimate is not None
    assert all(step.verb is None for step in said if step.decision.action is api.Action.HOLD)


def test_a_sensor_that_cannot_be_believed_and_a_device_hold_it() -> None:
    stepper = api.Stepper()
    for tick in range(1, 80):
        stepper.step(vector(40 * tick), 40 * tick * MS)
    blind = stepper.step(None, 3200 * MS, problem="camera is gone")
    assert blind.decision.reason is api.HoldReason.SENSOR_MISSING
    stopped = stepper.step(vector(3240), 3240 * MS, outside=api.HoldReason.STOPPED)
    assert stopped.decision.reason is api.HoldReason.STOPPED


def test_a_bundle_that_is_none_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(api.InputError, match="none\\.safetensors"):
        api.Stepper(tmp_path / "none.safetensors")
