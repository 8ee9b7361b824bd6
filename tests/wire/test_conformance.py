"""Two codecs, one contract: the quick, seeded part of `python -m tests.safety conformance`, and the golden frames."""

from __future__ import annotations

import pytest

from hilbridge.wire.codec import Codec
from tests.safety.wire import conformance

requirement = pytest.mark.requirement
CODEC = Codec()


@requirement("P10")
def test_random_values_both_ways() -> None:
    assert conformance.both_ways(CODEC, 12_000, seed=1) == 0


@requirement("P9", "P10")
def test_random_bytes_are_judged_alike() -> None:
    assert conformance.judged_alike(CODEC, 12_000, seed=2) == 0


@requirement("P10")
def test_golden_frames_are_made_and_read_by_both_ends() -> None:
    count, differ = conformance.golden_differ(CODEC)
    assert count == 97
    assert differ == 0
