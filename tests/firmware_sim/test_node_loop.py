"""The device's loop to the millisecond, and its nonces: from the system, of full length, never twice (H1, H9)."""

from __future__ import annotations

import io
import json
from typing import Any

import pytest

from firmware_sim import frames, node
from firmware_sim.attachment import Arrival
from firmware_sim.frames import STOP
from firmware_sim.memory import COUNT_LOST, COUNT_STALL_TICKS, COUNT_TRIPS, Received, Refusal
from firmware_sim.states import Reason, State
from hilbridge.limits import MS
from tests.firmware_sim.shared import Clock, make
from tests.safety.hand import Hand

START_NS = 5_000_000_000
requirement = pytest.mark.requirement


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    fake = Clock()
    monkeypatch.setattr(node.time, "monotonic_ns", fake.monotonic_ns)
    monkeypatch.setattr(node.time, "sleep", fake.sleep)
    return fake


class Source:
    """Stands in for the system's source of randomness: every byte asked for is another one."""

    def __init__(self) -> None:
        self.given = b""

    def token_bytes(self, length: int) -> bytes:
        first = len(self.given)
        block = b"".join((first + k).to_bytes(4, "big") for k in range(length // 4 + 1))[:length]
        self.given += block
        return block

    def randbits(self, bits: int) -> int:
        return int.from_bytes(self.token_bytes(bits // 8), "big")


# Randomness


@requirement("P6")
def test_h1_a_nonce_is_four_bytes_of_the_system_and_never_the_same_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    source = Source()
    monkeypatch.setattr(node, "secrets", source)
    made, _bus = make()
    drawn = [made._nonce() for _ in range(5000)]
    assert drawn == [int.from_bytes(source.given[4 * k : 4 * k + 4], "big") for k in range(5000)]
    assert len(set(drawn)) == 5000


@requirement("P6")
def test_h1_nonces_have_their_full_length() -> None:
    made, _bus = make()
    drawn = [made._nonce() for _ in range(400)]
    assert len(set(drawn)) == 400
    for bit in range(32):  # each bit is now this, now that: 2 in 2^400 for a fair one
        assert {nonce >> bit & 1 for nonce in drawn} == {0, 1}


@requirement("P6")
def test_h1_every_challenge_carries_a_fresh_device_nonce(clock: Clock) -> None:
    made, bus = make()
    asking = Hand()
    for at_ms in range(60, 460, 40):
        bus.arrivals.append(Arrival(START_NS + at_ms * MS, asking.request()))
    made.run(0.5)
    nonces = [frames.unpack(can_id, data)[1][0] for can_id, data in bus.log if can_id == frames.ARM_CHALLENGE]
    assert len(nonces) == len(set(nonces)) == 10


@requirement("P6")
def test_h1_every_boot_has_a_fresh_nonce_and_says_so(clock: Clock) -> None:
    made, bus = make()
    for k in range(5):
        made.commands.append("restart")
        made.stopping = False
        made.device.ticks = 0
        clock.now_ns = START_NS + k * 1000 * MS
        made.run(0.02)
    said = {frames.unpack(can_id, data)[1][1] for can_id, data in bus.log if can_id == frames.CTRL_HB}
    assert len(said) == 5
    assert made.device.state.boot_nonce in said


# Time


def run_noting(made: Any, seconds: float) -> list[tuple[int, int, int, bool]]:
    """Runs it; gives (tick, stalled, dropped, bus-off) of every tick."""
    seen = []
    tick = made.device.tick

    def noted(received: tuple[Received, ...], nonce: int, stalled: int, dropped: int) -> Any:
        seen.append((made.device.ticks + 1, stalled, dropped, made.device.bus_off))
        return tick(received, nonce, stalled, dropped)

    made.device.tick = noted
    made.run(seconds)
    return seen


def test_it_wakes_every_two_milliseconds_and_looks_a_last_time_at_the_end(clock: Clock) -> None:
    made, bus = make()
    made.run(0.1)
    assert bus.reads[:4] == [START_NS + k * 2 * MS for k in range(4)]
    assert bus.reads[-2:] == [START_NS + 100 * MS, START_NS + 102 * MS]
    assert made.device.ticks == 100
    assert made.stopping


@pytest.mark.parametrize(("seconds", "ticks"), [(2.0, 2000), (0.0016, 2), (0.0, 0)])
def test_it_runs_for_so_many_milliseconds_of_its_own(clock: Clock, seconds: float, ticks: int) -> None:
    made, _bus = make()
    made.run(seconds)
    assert made.device.ticks == ticks


@requirement("S11")
@pytest.mark.parametrize(("late_ms", "stalled"), [(4, 0), (5, 6), (20, 21)])
def test_from_seven_ticks_behind_on_it_is_a_stall(clock: Clock, late_ms: int, stalled: int) -> None:
    made, _bus = make()
    clock.jumps = {50: late_ms}
    seen = run_noting(made, 0.2)
    assert [entry[1] for entry in seen if entry[1]] == ([stalled] if stalled else [])
    assert made.most_behind == late_ms + 2
    assert made.device.state.counters[COUNT_STALL_TICKS] == stalled


def test_a_tick_sixty_back_is_sent_and_one_more_is_not(clock: Clock) -> None:
    made, bus = make()
    ticking = iter(range(1, 64))

    def tick(*_: object) -> tuple[tuple[int, bytes], ...]:
        made.device.ticks = next(ticking)
        return ((0x700, bytes((made.device.ticks,))), (0x701, b""))

    made.device.tick = tick  # type: ignore[method-assign]
    made._catch_up(63, START_NS)
    assert bus.dropped == 4  # two frames of each of the first two ticks
    assert [data[0] for can_id, data in bus.log if can_id == 0x700] == list(range(3, 64))
    assert bus.stamps[::2] == [START_NS + k * MS for k in range(3, 64)]


def test_a_frame_belongs_to_the_tick_in_which_it_arrived(clock: Clock) -> None:
    made, bus = make()
    bus.arrivals = [Arrival(START_NS + 50 * MS + after, Received(0x700 + after, b"")) for after in (0, 1)]
    seen: list[tuple[int, int]] = []
    tick = made.device.tick

    def noted(received: tuple[Received, ...], *rest: int) -> tuple[tuple[int, bytes], ...]:
        seen.extend((made.device.ticks + 1, frame.can_id) for frame in received)
        return tick(received, *rest)

    made.device.tick = noted  # type: ignore[method-assign]
    made.run(0.1)
    assert seen == [(50, 0x700), (51, 0x701)]


def test_bus_off_is_of_the_bus_or_of_the_command(clock: Clock) -> None:
    made, bus = make()
    bus.dropped = 7
    assert {entry[2:] for entry in run_noting(made, 0.01)} == {(7, False)}
    for of_bus, forced in ((True, False), (False, True), (True, True)):
        made, bus = make()
        clock.now_ns = START_NS
        bus.bus_off, made.forced_bus_off = of_bus, forced
        assert {entry[3] for entry in run_noting(made, 0.01)} == {True}


# What is told


def test_a_line_for_every_change_of_what_matters(clock: Clock) -> None:
    log = io.StringIO()
    made, _bus = make(log, log_cycle_ms=1000)
    state = made.device.state
    made.device.ticks = 1
    lines = []
    for change in (
        {},
        {},
        {"state": State.FOLLOW},
        {"reason": Reason.HOLD},
        {"armed": True},
        {"command_live": True},
        {"command_is_hold": True},
        {"command_ms": 9},
        {},
    ):
        for name, value in change.items():
            setattr(state, name, value)
        made._log_tick(1)
        lines.append(log.getvalue().count("\n"))
    assert lines == [1, 1, 2, 3, 4, 5, 6, 7, 7]
    state.torque.assist_unm = 5
    made._log_tick(2)
    state.torque.assist_unm = 6
    made._log_tick(3)
    made._stop_ms = 4
    made._log_tick(4)
    rows = [json.loads(line) for line in log.getvalue().splitlines()]
    assert [row["ends_ns"] for row in rows] == [1] * 7 + [2, 4]
    assert rows[-1]["stop_ms"] == 4
    assert [row["accepted_live"] for row in rows] == [False] * 4 + [True] * 5


def test_a_stop_is_stamped_once_and_no_other_frame_is_one(clock: Clock) -> None:
    made, bus = make()
    bus.arrivals = [
        Arrival(START_NS + at_ms * MS, Received(can_id, b""))
        for at_ms, can_id in ((20, 0x700), (60, STOP), (60, 0x701), (70, STOP))
    ]
    made.run(0.03)
    assert made._stop_ms is None
    made.stopping = False
    made.device.ticks = 0
    clock.now_ns = START_NS + 30 * MS
    made.run(0.1)
    assert made._stop_ms == made.device.state.last_tick_ms - 70  # 30 ms into the second run


def test_nothing_is_logged_where_nobody_wants_a_log(clock: Clock) -> None:
    made, _bus = make()
    made.run(0.1)
    made._write({"x": 1})


def test_it_says_what_a_latch_waits_for_when_that_changes(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    made, _bus = make()
    made._announce()
    assert capsys.readouterr().out == ""
    state = made.device.state
    state.state, state.reason = State.LATCHED, Reason.OWN_ID_SEEN
    made._announce()
    made._announce()
    said = capsys.readouterr().out
    assert said.startswith("firmware-sim Latched (OwnIdSeen): waits for a bridge that authenticates clearing")
    assert said.count("\n") == 1
    state.clear_until_ms = 10**9
    made._announce()
    assert capsys.readouterr().out == "firmware-sim Latched (OwnIdSeen): waits for HOLD from the bridge\n"
    state.state = State.FOLLOW
    made._announce()
    made._announce()
    assert capsys.readouterr().out == "firmware-sim cleared: Follow\n"


def test_it_says_why_a_handshake_was_refused_once(capsys: pytest.CaptureFixture[str]) -> None:
    made, _bus = make()
    key = "wrong MAC, the bridge has another key; give both the same --key-file"
    disturbed = "two asked at once, a second bridge or a stranger; the bridge tries again"
    late = "an answer too late, or to no challenge; the bridge tries again"
    for refusal, says in (
        (Refusal.NONE, ""),
        (Refusal.KEY, f"firmware-sim handshake refused: {key}\n"),
        (Refusal.KEY, ""),
        (Refusal.DISTURBED, f"firmware-sim handshake refused: {disturbed}\n"),
        (Refusal.LATE, f"firmware-sim handshake refused: {late}\n"),
        (Refusal.NONE, "firmware-sim handshake accepted\n"),
    ):
        made.device.state.refusal = refusal
        made._announce()
        assert capsys.readouterr().out == says


def test_the_hand_at_the_device_is_told_what_became_of_it(capsys: pytest.CaptureFixture[str]) -> None:
    made, _bus = make()
    made._confirm()
    assert "clear refused: nothing is latched\n" in capsys.readouterr().out
    state = made.device.state
    state.state, state.clear_until_ms = State.LATCHED, 10**9
    state.command_live = state.command_is_hold = True
    made.device.local_clear = False
    made._confirm()
    assert made.device.local_clear
    assert capsys.readouterr().out == ""


def test_the_last_line_has_every_account() -> None:
    made, bus = make()
    assert made.summary()["most_behind_ms"] == 0
    bus.received, bus.sent, bus.dropped, bus.link_errors = 11, 12, 13, 14
    made.device.ticks, made.most_behind, made.device.peak_assist_unm = 1500, 8, 1_234_567
    counters = list(made.device.state.counters)
    counters[0], counters[COUNT_TRIPS], counters[COUNT_LOST], counters[COUNT_STALL_TICKS] = 9, 2, 3, 4
    counters[frames.Reject.KIND], counters[frames.Reject.HANDSHAKE] = 5, 6
    made.device.state.counters = tuple(counters)
    assert made.summary() == {
        "seconds": 1.5,
        "state": "Boot",
        "reason": "None",
        "received": 11,
        "sent": 12,
        "send_dropped": 13,
        "link_errors": 14,
        "rejected": {"kind": 5, "handshake": 6},
        "trips": 2,
        "lost_frames": 3,
        "stall_ticks": 4,
        "most_behind_ms": 8,
        "peak_assist_nm": 1.235,
    }
