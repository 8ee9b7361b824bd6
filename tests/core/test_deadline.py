from __future__ import annotations

import pytest

from hilbridge.core.deadline import Deadline

requirement = pytest.mark.requirement


@requirement("W9")
def test_deadline_expires_at_its_limit_and_before_it_was_ever_fed() -> None:
    deadline = Deadline(60)
    assert deadline.expired(0)
    deadline = deadline.fed(100)
    assert not deadline.expired(159)
    assert deadline.expired(160)
    assert deadline.limit_ns == 60
