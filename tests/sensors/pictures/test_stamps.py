"""sensors.pictures.stamps: a stream's pictures by the sender's clock, known or only its quickest arrivals."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.limits import MS
from hilbridge.records import StampSource
from hilbridge.sensors.clock import DeviceClock, Probe
from hilbridge.sensors.pictures.stamps import SenderStamps

HERE_NS, SENDER_NS = 10**12, 1_790_000_000 * 10**9


def known(offset_ns: int) -> DeviceClock:
    clock = DeviceClock()
    for number in range(10):
        at_ns = HERE_NS + number * 100 * MS
        clock.add(Probe(at_ns, at_ns - offset_ns + MS, at_ns + 2 * MS))
    return clock


def test_jitter_of_the_way_is_gone_and_the_spacing_is_the_senders() -> None:
    stamps, late, last_ns = SenderStamps(), random.Random(1), 0
    errors = []
    for number in range(200):
        taken_ns = number * 40 * MS
        now_ns = HERE_NS + taken_ns + 30 * MS + round(late.expovariate(1 / 10) * MS)
        last_ns, stamp = stamps.taken_at(SENDER_NS + taken_ns, now_ns, 30 * MS, last_ns)
        assert stamp is StampSource.RTCP
        errors.append(abs(last_ns - HERE_NS - taken_ns))
    assert max(errors[25:]) < 2 * MS


def test_a_sender_whose_clock_is_asked_for_is_absolute() -> None:
    offset_ns = HERE_NS - SENDER_NS
    stamps = SenderStamps(known(offset_ns))
    now_ns = HERE_NS + 1100 * MS
    captured_ns, stamp = stamps.taken_at(SENDER_NS + 1000 * MS, now_ns, 30 * MS, 0)
    assert stamp is StampSource.RTCP
    assert abs(captured_ns - (HERE_NS + 1000 * MS)) <= MS


@pytest.mark.parametrize("ahead_ns", [-2000 * MS, 500 * MS])
def test_a_stamp_that_cannot_be_is_arrival(ahead_ns: int) -> None:
    stamps = SenderStamps(known(HERE_NS - SENDER_NS))
    now_ns = HERE_NS + 1100 * MS
    assert stamps.taken_at(SENDER_NS + 1100 * MS + ahead_ns, now_ns, 30 * MS, 0) == (
        now_ns - 30 * MS,
        StampSource.ARRIVAL,
    )


def test_without_a_clock_or_a_stamp_it_is_arrival() -> None:
    assert SenderStamps().taken_at(None, HERE_NS, 5, 0) == (HERE_NS - 5, StampSource.ARRIVAL)
    assert SenderStamps(DeviceClock()).taken_at(SENDER_NS, HERE_NS, 5, 0) == (HERE_NS - 5, StampSource.ARRIVAL)


def test_a_sender_whose_clock_is_set_is_learnt_anew() -> None:
    stamps = SenderStamps()
    stamps.taken_at(SENDER_NS, HERE_NS, 0, 0)
    for step_ns in (3600 * 10**9, -3600 * 10**9):
        captured_ns, stamp = stamps.taken_at(SENDER_NS + step_ns + 40 * MS, HERE_NS + 40 * MS, 0, 0)
        assert (captured_ns, stamp) == (HERE_NS + 40 * MS, StampSource.RTCP)


@given(st.lists(st.tuples(st.integers(0, 10**9), st.integers(-(10**10), 10**10) | st.none()), max_size=60))
def test_stamps_neither_go_back_nor_lie_ahead(steps: list[tuple[int, int | None]]) -> None:
    stamps, now_ns, last_ns = SenderStamps(), HERE_NS, 0
    for step_ns, off_ns in steps:
        now_ns += step_ns + 2
        before_ns = last_ns
        last_ns, _ = stamps.taken_at(None if off_ns is None else SENDER_NS + now_ns + off_ns, now_ns, 5 * MS, last_ns)
        assert before_ns < last_ns <= now_ns
