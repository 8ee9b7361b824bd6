"""core.sensing: after any gap ACT is earned anew for a fixed time, and the cause of the gap is what people see (H8, H9)."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from hilbridge.core.sensing import Sensing
from hilbridge.limits import EARN_NS, MS
from hilbridge.records import HoldReason

TICK = 40 * MS
GAPS = (
    HoldReason.OVERRUN,
    HoldReason.SENSOR_MISSING,
    HoldReason.WARMING_UP,
    HoldReason.NO_ESTIMATE,
    HoldReason.STALE,
)


def after(*gaps: HoldReason | None, start: Sensing | None = None) -> tuple[Sensing, int]:
    """The state after one tick for each gap, and the time of the last."""
    sensing = start or Sensing()
    for index, gap in enumerate(gaps):
        sensing = sensing.step(gap, index * TICK)
    return sensing, (len(gaps) - 1) * TICK


def test_the_contract_asks_for_400_ms_at_least() -> None:
    assert EARN_NS >= 400 * MS


def test_h8_a_bridge_that_starts_has_earned_nothing() -> None:
    assert Sensing().objection(0) is HoldReason.WARMING_UP
    assert not Sensing().is_whole
    sensing = Sensing().step(None, 7)
    assert sensing.is_whole
    assert sensing.objection(7 + EARN_NS - 1) is HoldReason.WARMING_UP
    assert sensing.step(None, 7 + EARN_NS - 1).objection(7 + EARN_NS) is None


def test_h9_the_cause_is_named_while_trust_is_earned_and_not_what_follows_from_it() -> None:
    gone = HoldReason.SENSOR_MISSING
    sensing, now = after(gone, HoldReason.WARMING_UP, None)
    assert sensing.objection(now) is gone
    sensing, now = after(gone, *[HoldReason.WARMING_UP] * 9)
    assert sensing.objection(now) is gone
    sensing, now = after(gone, *[HoldReason.WARMING_UP] * 10)  # the sensor is long back: the window is what is awaited
    assert sensing.objection(now) is HoldReason.WARMING_UP


def test_h9_a_cause_replaces_another_and_any_aftermath_another_one() -> None:
    for first in GAPS:
        for cause in (HoldReason.OVERRUN, HoldReason.SENSOR_MISSING):
            sensing, now = after(first, cause)
            assert sensing.objection(now) is cause
    sensing, now = after(HoldReason.WARMING_UP, HoldReason.STALE)
    assert sensing.objection(now) is HoldReason.STALE


def test_a_clock_that_goes_back_starts_the_time_anew() -> None:
    sensing = Sensing().step(None, 10 * EARN_NS).step(None, 5)
    assert sensing.objection(10 * EARN_NS) is None
    assert sensing.objection(4 + EARN_NS) is HoldReason.WARMING_UP


@given(st.lists(st.tuples(st.sampled_from([None, None, None, *GAPS]), st.integers(1, 90)), max_size=80))
def test_h8_no_order_of_gaps_shortens_the_time(ticks: list[tuple[HoldReason | None, int]]) -> None:
    sensing, now, whole_since = Sensing(), 0, None
    for gap, step_ms in ticks:
        now += step_ms * MS
        whole_since = None if gap is not None else now if whole_since is None else whole_since
        sensing = sensing.step(gap, now)
        earned = whole_since is not None and now - whole_since >= EARN_NS
        assert sensing.is_whole is (gap is None)
        assert (sensing.objection(now) is None) is earned
        assert gap not in (HoldReason.OVERRUN, HoldReason.SENSOR_MISSING) or sensing.objection(now) is gap
