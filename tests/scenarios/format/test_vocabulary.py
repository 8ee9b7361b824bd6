"""hilscenario.format.vocabulary: every fault has readable defaults within its limits."""

from __future__ import annotations

from hilscenario.format.vocabulary import FAULTS


def test_every_fault_has_readable_defaults_within_its_limits() -> None:
    for name, kind in FAULTS.items():
        assert kind.about
        for option, limits in kind.options.items():
            assert limits.low <= limits.default <= limits.high, (name, option)
            assert limits.about
