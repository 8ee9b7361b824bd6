"""The C controller and the reference are the same; the long run is the part `twin` of `python -m tests.safety`."""

from __future__ import annotations

import json
from copy import copy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_sim import frames
from firmware_sim.c import binding, flat
from firmware_sim.controller import advance
from firmware_sim.law.memory import WINDOW_SLOTS
from firmware_sim.memory import Command, ControllerState, Inputs, PendingAct, Received
from firmware_sim.states import Reason, State
from firmware_sim.watchdogs import Limits
from tests.safety.hand import BOOT_NONCE, KEY, Hand
from tests.safety.stepping import copied
from tests.safety.table import Scale, printed
from tests.safety.tools.c import twin

pytestmark = pytest.mark.skipif(not binding.available(), reason="the C controller is not built")


def loaded(state: ControllerState) -> binding.CController:
    c = binding.CController(bytes(16), 0)
    c.load(flat.flat(state))
    return c


def both(state: ControllerState, inputs: Inputs, now_ms: int) -> ControllerState:
    """The state after a tick, which is the same in C."""
    c, after = loaded(state), copied(state)
    advance(after, inputs, now_ms)
    c.advance(inputs, now_ms)
    assert c.differs(flat.flat(after)) == -1
    assert c.reference() == after
    return after


def test_random_sequences_are_the_same_in_both() -> None:
    rows = twin.run(Scale(quick=True))
    assert all(row.holds for row in rows), printed(rows)


def test_a_difference_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """One count too many in the reference, and the first tick with a frame tells."""
    monkeypatch.setattr(twin, "advance", lambda state, inputs, now: advance(state, inputs, now + 1))
    rows = twin.run(Scale(quick=True))
    assert not rows[0].holds
    assert "here" in rows[0].figure


def test_the_order_of_the_numbers_is_that_of_the_c() -> None:
    assert tuple(binding._native.PLAIN.split()) == flat.PLAIN
    assert tuple(binding._native.LAW.split()) == flat.LAW


def test_a_state_survives_the_way_there_and_back() -> None:
    for hand in (Hand(), Hand().to_ready(), Hand().to_assist()):
        assert flat.state_of(flat.flat(hand.state)) == hand.state
        assert loaded(hand.state).reference() == hand.state


def test_power_on_is_the_same() -> None:
    limits = Limits(-5_000, 120_000, 300_000, 500_000)
    assert binding.CController(KEY, BOOT_NONCE).reference() == ControllerState(KEY, BOOT_NONCE)
    assert binding.CController(KEY, BOOT_NONCE, limits).reference() == ControllerState(KEY, BOOT_NONCE, limits)


@pytest.mark.parametrize(
    "wrong",
    [
        (-20_001, 0, 1, 1),
        (10, 10, 1, 1),
        (0, 160_001, 1, 1),
        (0, 1, 0, 1),
        (0, 1, 600_001, 1),
        (0, 1, 1, 0),
        (0, 1, 1, 1_000_001),
    ],
)
def test_limits_out_of_bounds_are_refused(wrong: tuple[int, ...]) -> None:
    names = ("angle_low_mdeg", "angle_high_mdeg", "speed_limit_mdeg_s", "tracking_limit_unm")
    with pytest.raises(ValueError, match="limits"):
        binding.CController(KEY, 1, SimpleNamespace(**dict(zip(names, wrong, strict=True))))  # type: ignore[arg-type]


def test_what_python_reads_in_every_tick_is_read_alike() -> None:
    hand = Hand().to_assist()
    c = loaded(hand.state)
    for name in (
        "state",
        "reason",
        "refusal",
        "armed",
        "command_live",
        "command_is_hold",
        "counters",
        "trips",
        "outbox",
    ):
        mine, theirs = getattr(c, name), getattr(hand.state, name)
        assert mine == theirs
        assert type(mine) is type(theirs)
    assert c.torque.assist_unm == hand.state.torque.assist_unm
    assert c.receivers == hand.state.receivers
    assert c.limits == hand.state.limits
    with pytest.raises(AttributeError):
        _ = c.nothing


def test_a_copy_goes_its_own_way() -> None:
    c = loaded(Hand().to_assist().state)
    twin_ = copy(c)
    assert twin_.dump() == c.dump()
    c.advance(Inputs(frames=(Received(frames.STOP, b""),)), c.last_tick_ms + 1)
    assert (c.state, twin_.state) == (State.ESTOP, State.ASSIST)
    assert c.torque.assist_unm != 0


def test_moments_that_no_sequence_comes_to() -> None:
    ready = Hand().to_ready().state
    now_ms = ready.last_tick_ms + 1
    never_heard = replace(Hand().to_follow().state, command_live=True, command_ms=0)
    assert both(never_heard, Inputs(), 1_000).command_live is False
    later = PendingAct(now_ms + 50, bytes(8), 1, 1)
    assert (
        both(replace(ready, pending=later, commands=(Command(now_ms + 50, bytes(8)),)), Inputs(), now_ms).pending
        is None
    )
    tall = replace(ready, counters=(2**32 - 1,) * len(ready.counters))
    assert both(tall, Inputs(tx_dropped=2**32 - 1), now_ms).counters == tall.counters
    assert both(
        replace(ready, previous_mdeg=90_000), Inputs(angle_mdeg=90_000, second_angle_mdeg=90_000), now_ms
    ).follow_unm


@pytest.mark.parametrize("spot", range(WINDOW_SLOTS))
def test_damping_rises_from_the_least_of_the_whole_window(spot: int) -> None:
    hand = Hand().to_assist()
    state = copied(hand.state)
    state.verb = 6
    law = state.torque
    law.assist_ticks = law.authority = 1_000
    law.wave_ticks = law.last_ticks = law.before_ticks = 40
    law.last_peak = law.before_peak = law.gain_most = 300_000
    law.slow_mean = law.second_mean = law.slot_tick = 0
    law.impulse = 2_000_000  # the other way, so that the leash is loose
    law.wave_up, law.damping_unm = True, -950_000
    law.peaks = tuple(1_500_000 * (at != spot) for at in range(WINDOW_SLOTS))
    after = both(state, replace(hand.inputs, velocity_mdeg_s=25_000), hand.now_ms + 1)
    assert after.torque.damping_unm == -900_000
    law.peaks = (1_500_000,) * WINDOW_SLOTS
    after = both(state, replace(hand.inputs, velocity_mdeg_s=25_000), hand.now_ms + 1)
    assert after.torque.damping_unm < -930_000


def test_the_last_micronewtonmetre_of_a_ramp() -> None:
    """Assist of 1 uN m on either side is still on its way, 0 is not."""
    hand = Hand().to_assist()
    hand.tick(hand.hold())
    assert hand.state.state is State.RAMP_DOWN
    for before in (-1, 0, 1):
        for guide, damping in ((0, 1_000), (0, -1_000), (1_500, 0), (-1_500, 0)):
            state = copied(hand.state)
            law = state.torque
            law.assist_unm, law.guide_from_unm, law.damping_from_unm = before, guide, damping
            law.damping_unm = (damping > 0) - (damping < 0)
            for speed in (-500, 500):
                both(state, replace(hand.inputs, velocity_mdeg_s=speed), hand.now_ms + 1)


def test_a_session_that_begins_while_assisting_changes_nothing() -> None:
    hand = Hand().to_ready()
    hand.tick(hand.request())
    answer = hand.response()
    hand.tick(*hand.act())
    assert hand.state.state == State.ASSIST
    after = both(hand.state, replace(hand.inputs, frames=(answer,)), hand.now_ms + 1)
    assert after.session == hand.session


@pytest.mark.parametrize(
    "frame", [(1, b"", True, 4), (1, "text", True), [1, b"", True], (2**70, b"", True), (None, b"", True)]
)
def test_what_is_no_frame_is_an_error_of_the_caller(frame: object) -> None:
    c = binding.CController(KEY, 1)
    before = c.dump()
    with pytest.raises((TypeError, OverflowError)):
        c.advance(Inputs(frames=(frame,)), 1)  # type: ignore[arg-type]
    assert c.dump() == before


def test_readings_beyond_32_bits_saturate() -> None:
    c = binding.CController(KEY, 1)
    c.advance(Inputs(angle_mdeg=10**12, user_torque_unm=-(10**30)), 1)
    assert c.reference().previous_mdeg == 2**31 - 1
    assert c.reference().previous_user_unm == -(2**31)


def test_the_self_test_fails_on_limits_that_memory_lost() -> None:
    numbers = list(binding.CController(KEY, 1).dump())
    place = next(at for at in range(len(numbers)) if numbers[at : at + 4] == [0, 145_000, 400_000, 600_000])
    numbers[place + 2] = 10**9
    c = binding.CController(KEY, 1)
    c.load(tuple(numbers))
    for now_ms in range(1, 60):
        c.advance(Inputs(), now_ms)
    assert (c.state, c.reason) == (State.LATCHED, Reason.SELF_TEST_FAILED)


def test_more_requests_than_the_outbox_holds_are_dropped_and_counted() -> None:
    hand = Hand().to_follow()
    asked = tuple(hand.request() for _ in range(40))
    after = both(hand.state, replace(hand.inputs, frames=asked), hand.now_ms + 1)
    assert len(after.outbox) == 32
    assert after.counters[24] >= 8


def test_golden_frames_are_taken_alike() -> None:
    """Every frame of dbc/golden_frames.json, each from power-on's next tick, and all of the bridge's in a row."""
    path = Path(__file__).parents[3] / "dbc" / "golden_frames.json"
    golden = [Received(one["id"], bytes.fromhex(one["data"])) for one in json.loads(path.read_text())]
    assert {frame.can_id for frame in golden} >= {frames.STOP, *frames.RECEIVED_IDS, *frames.OWN_IDS}
    hand = Hand().to_ready()
    for frame in golden:
        both(hand.state, replace(hand.inputs, frames=(frame,)), hand.now_ms + 1)
    bridge = tuple(frame for frame in golden if frame.can_id in frames.RECEIVED_IDS)
    both(hand.state, replace(hand.inputs, frames=bridge), hand.now_ms + 1)
