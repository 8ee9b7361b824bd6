"""Worst-case response times: the textbook's example, and the medium itself as the judge."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from hilbridge.bus.analysis import analyse, as_text, exact_frame_bits, load, responses, with_exact_bits
from hilbridge.bus.message_set import Stream, streams_of_dbc, worst_frame_bits
from hilbridge.bus.model.bits import INTERMISSION_BITS
from hilbridge.bus.model.events import Delivered
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.medium import Medium
from hilbridge.errors import InputError
from hilbridge.limits import MS

DBC = Path(__file__).parents[2] / "dbc" / "iassistadl.dbc"
BITRATES = (125_000, 250_000, 500_000, 1_000_000)


def stream(name: str, key: int, bits: int, period_us: int, deadline_us: int) -> Stream:
    return Stream(name, key, key, 8, bits, period_us * 1000, deadline_us * 1000)


def test_the_example_of_davis_et_al() -> None:
    # Section 3.3: three messages of 125 bits at 125 kbit/s, 1 ms each: periods 2.5, 3.5, 3.5 ms. The first instance of C
    # responds in 3.0 ms, its second in 3.5: only looking at the whole busy period finds that.
    messages = [
        stream("A", 1, 125, 2500, 2500),
        stream("B", 2, 125, 3500, 3250),
        stream("C", 3, 125, 3500, 3250),
    ]
    found = {response.stream.name: response for response in responses(messages, 125_000)}
    assert {name: response.worst_ns for name, response in found.items()} == {
        "A": 2_000_000,
        "B": 3_000_000,
        "C": 3_500_000,
    }
    assert found["C"].margin_ns == -250_000


def test_worst_bits_of_a_frame_are_the_textbooks() -> None:
    assert [worst_frame_bits(length) for length in (0, 1, 8)] == [55, 65, 135]
    assert worst_frame_bits(8, extended=True) == 160


def measured_ns(streams: list[Stream], frames: dict[int, WireFrame], bitrate: int, judged: Stream) -> int:
    """The longest delay of `judged` when all come at once just after the longest less urgent frame has begun.

    From queueing to the end of intermission. Each message has a node of its own, as long as the busy period lasts.
    """
    medium = Medium(bitrate)
    nodes = {entry.can_id: medium.attach(entry.name, queue_limit=1000) for entry in streams}
    medium.attach("listener")
    lower = [entry for entry in streams if entry.key > judged.key]
    horizon_ns = 50 * MS if bitrate > 200_000 else 100 * MS
    sends = [
        (at_ns, entry)
        for entry in streams
        if entry.key <= judged.key
        for at_ns in range(1, horizon_ns, entry.period_ns)
    ]
    if lower:
        sends.append((0, max(lower, key=lambda entry: entry.frame_bits)))
    waiting: list[int] = []
    worst = 0
    events: list[Delivered] = []
    for at_ns, entry in sorted(sends, key=lambda item: item[0]):
        events += [event for event in medium.advance(at_ns) if isinstance(event, Delivered)]
        medium.send(nodes[entry.can_id], frames[entry.can_id], 0, at_ns)
        if entry is judged:
            waiting.append(at_ns)
    events += [event for event in medium.advance(10 * horizon_ns) if isinstance(event, Delivered)]
    arrived = [event.at_ns for event in events if event.frame.can_id == judged.can_id]
    assert len(arrived) == len(waiting)
    for queued_ns, at_ns in zip(waiting, arrived, strict=True):
        worst = max(worst, at_ns - queued_ns + medium.duration_ns(INTERMISSION_BITS))
    return worst


@pytest.mark.parametrize("bitrate", BITRATES)
def test_the_medium_delays_each_message_of_the_dbc_by_exactly_its_worst_case(bitrate: int) -> None:
    streams = streams_of_dbc(DBC)
    # STOP has no payload; the others get one that takes many stuff bits.
    frames = {
        entry.can_id: WireFrame(entry.can_id, (b"\x0f\x0f\x3c\x3c\x00\x00\xff\xf0" * 2)[: entry.payload_bytes])
        for entry in streams
    }
    exact = with_exact_bits(streams, frames)
    bounds = {response.stream.can_id: response.worst_ns for response in responses(streams, bitrate)}
    for response in responses(exact, bitrate):
        seen_ns = measured_ns(exact, frames, bitrate, response.stream)
        # The longest frame begins one nanosecond before the others come: that is all a strict inequality costs.
        blocked = 1 if response.stream.key < max(entry.key for entry in exact) else 0
        assert seen_ns == (response.worst_ns or 0) - blocked, response.stream.name
        assert response.worst_ns is not None
        bound = bounds[response.stream.can_id]
        assert bound is not None
        assert response.worst_ns <= bound


def test_on_an_overloaded_bus_the_least_urgent_starve_and_the_analysis_says_so() -> None:
    streams = [
        replace(
            entry,
            period_ns=int(1.5 * MS),
            frame_bits=exact_frame_bits(WireFrame(entry.can_id, bytes(entry.payload_bytes))),
        )
        for entry in streams_of_dbc(DBC)
    ]
    found = responses(streams, 250_000)
    assert load(streams, 250_000) > 1.0
    starved = {response.stream.can_id for response in found if response.worst_ns is None}
    served = {response.stream.can_id for response in found if response.worst_ns is not None}
    assert max(served) < min(starved)
    medium = Medium(250_000)
    nodes = {entry.can_id: medium.attach(entry.name) for entry in streams}
    arrived: list[int] = []
    for cycle in range(200):
        at_ns = cycle * int(1.5 * MS)
        arrived += [event.frame.can_id for event in medium.advance(at_ns) if isinstance(event, Delivered)]
        for entry in streams:
            medium.send(nodes[entry.can_id], WireFrame(entry.can_id, bytes(entry.payload_bytes)), 0, at_ns)
    assert all(arrived.count(can_id) >= 198 for can_id in served)
    assert arrived.count(max(starved)) == 0
    assert all(arrived.count(can_id) < 198 for can_id in starved)


def test_errors_on_the_wire_cost_what_they_repeat() -> None:
    messages = [stream("A", 1, 125, 10_000, 10_000), stream("B", 2, 125, 10_000, 10_000)]
    clean = responses(messages, 500_000)
    disturbed = responses(messages, 500_000, error_interval_ns=100 * MS)
    # One error frame of 31 bits and one frame again: 156 bits of 2 us.
    assert [(d.worst_ns or 0) - (c.worst_ns or 0) for c, d in zip(clean, disturbed, strict=True)] == [312_000, 312_000]


def test_one_identifier_twice_is_refused() -> None:
    with pytest.raises(InputError, match="one identifier"):
        responses([stream("A", 1, 125, 1000, 1000), stream("B", 1, 125, 1000, 1000)], 500_000)


def test_report_has_load_and_margins_and_is_json() -> None:
    result = json.loads(json.dumps(analyse(DBC, 500_000)))
    assert 0.05 < result["load"] < 0.5
    assert result["schedulable"] is True
    by_name = {entry["name"]: entry for entry in result["messages"]}
    # STOP: one longest frame of 135 bits in its way, then its own 55: 190 bits of 2 us.
    assert by_name["STOP"]["worst_case_latency_ms"] == 0.38
    assert (
        by_name["ACT_CMD"]["margin_ms"]
        == by_name["ACT_CMD"]["deadline_ms"] - by_name["ACT_CMD"]["worst_case_latency_ms"]
    )
    assert by_name["ACT_AUTH"]["deadline_ms"] == 10.0
    assert "STOP" in as_text(result)
    assert analyse(DBC, 500_000, error_interval_ms=10.0)["messages"][0]["worst_case_latency_ms"] > 0.38


def test_files_and_rates_that_cannot_be_used_say_so_in_one_line(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.dbc"
    wrong.write_text("this is no DBC")
    for path, bitrate, says in (
        (tmp_path / "none.dbc", 500_000, "none.dbc"),
        (wrong, 500_000, "no DBC"),
        (DBC, 0, "bit rate 0"),
        (DBC, 2_000_000, "bit rate 2000000"),
    ):
        with pytest.raises(InputError, match=says) as caught:
            analyse(path, bitrate)
        assert "\n" not in str(caught.value)
