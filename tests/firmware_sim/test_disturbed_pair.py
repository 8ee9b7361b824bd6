"""A stranger's plain commands beside an ACT and its ACT_AUTH: nothing acts by them, and they latch nothing (H1)."""

from __future__ import annotations

import pytest

from firmware_sim import e2e, frames
from firmware_sim.frames import Reject
from firmware_sim.memory import COUNT_MAC_FAILURES, Received
from firmware_sim.states import State
from tests.safety.hand import Hand
from tests.safety.rig import ACT_TAKE, Rig

requirement = pytest.mark.requirement


def strangers_act(rig: Rig, step: int = 1, **other: int) -> Received:
    """A plain ACT_CMD, right in all but the key, or the echo; its counter is `step` after the bridge's last."""
    last = next(frame for frame in reversed(rig.sent) if frame.can_id == frames.ACT_CMD)
    _, values = frames.unpack(frames.ACT_CMD, last.data)
    session, echo, age = values[3], other.get("echo", values[4]), values[5]
    data = frames.pack(frames.ACT_CMD, (frames.GATE_ACT, 10, 90, session, echo, age))
    return Received(frames.ACT_CMD, e2e.protect(frames.ACT_CMD, data, last.data[2] + step))


def spoil(rig: Rig, what: str, inserted: int) -> None:
    """Plain commands of a stranger beside the bridge's next pair; returns when the pair has come."""
    last = next(frame for frame in reversed(rig.sent) if frame.can_id == frames.ACT_CMD)
    right = strangers_act(rig)
    pair: list[Received] = []

    def disturb(frame: Received) -> list[Received]:
        if pair or frame.can_id not in (frames.ACT_CMD, frames.ACT_AUTH):
            return [frame]
        if what == "between" and frame.can_id == frames.ACT_AUTH:
            pair.append(frame)
            return [*(strangers_act(rig, 1 + k) for k in range(inserted)), frame]
        if what == "wrong echo" and frame.can_id == frames.ACT_AUTH:
            pair.append(frame)
            return [*(strangers_act(rig, 1 + k, echo=(last.data[2] + 128) & 0xFF) for k in range(inserted)), frame]
        if what == "first" and frame.can_id == frames.ACT_CMD:
            pair.append(frame)
            return [right, frame]
        return [frame]

    rig.to_device = disturb
    while not pair:
        rig.tick()
    rig.to_device = lambda frame: [frame]


@requirement("P6", "S6")
@pytest.mark.parametrize(
    ("what", "inserted"),
    [("between", 1), ("between", 2), ("between", 3), ("wrong echo", 1), ("wrong echo", 3), ("first", 1)],
)
def test_h1_plain_commands_beside_an_act_and_its_authorisation_latch_nothing_and_act_nothing(
    what: str, inserted: int
) -> None:
    rig = Rig().assisting(ACT_TAKE)
    for _ in range(8):  # three wrong MACs would latch, and three trips in a minute
        spoil(rig, what, inserted)
        assert rig.state.state is not State.ASSIST
        rig.run(60).until("ASSIST")
        assert rig.state.verb == 1  # the bridge's, not the stranger's
    assert rig.state.counters[COUNT_MAC_FAILURES] == 0
    assert rig.state.trips == ()


@requirement("P6", "S6")
@pytest.mark.parametrize("inserted", [4, 12])
def test_h1_a_flood_between_an_act_and_its_authorisation_acts_nothing_and_is_no_wrong_mac(inserted: int) -> None:
    rig = Rig().assisting(ACT_TAKE)
    for _ in range(2):
        spoil(rig, "between", inserted)
        assert rig.state.state is not State.ASSIST
        rig.run(60).until("ASSIST")
    assert rig.state.counters[COUNT_MAC_FAILURES] == 0


@requirement("P6")
def test_an_authorisation_that_was_overtaken_is_used_up() -> None:
    hand = Hand().to_ready()
    command = hand.act_cmd(frames.GATE_ACT, 1)
    right = hand.auth(command)
    hand.tick(command, hand.act_cmd(frames.GATE_ACT, 10), right)
    assert (hand.state.state, hand.state.freshness) == (State.READY, 1)
    assert (hand.count(Reject.AUTH_UNPAIRED), hand.count(Reject.AUTH_MISSING)) == (1, 2)
    assert hand.state.pending is None
    assert (hand.state.command_ms, hand.state.command_is_hold, hand.state.accepted_counter) == (
        hand.now_ms,
        True,
        command.data[2],
    )
    again = hand.act_cmd(frames.GATE_ACT, 1)
    hand.tick(again, hand.auth(again, freshness=1))
    assert hand.state.mac_failures == 1


@requirement("P6", "S6")
@pytest.mark.parametrize(("before", "looked_at"), [(0, True), (3, True), (4, False), (9, False)])
def test_h1_guesses_hide_behind_commands_only_where_nobody_looks_at_them(before: int, looked_at: bool) -> None:
    hand = Hand().to_ready()
    commands = [hand.act_cmd(frames.GATE_ACT, 1) for _ in range(1 + before)]
    right = hand.auth(commands[-1])
    hand.tick(*commands, hand.auth(commands[-1], freshness=1, key=b"not the true key"))
    assert hand.state.mac_failures == int(looked_at)
    hand = Hand().to_ready()
    commands = [hand.act_cmd(frames.GATE_ACT, 1) for _ in range(1 + before)]
    right = hand.auth(commands[-1])
    hand.tick(*commands, right)
    assert (hand.state.state is State.ASSIST) == looked_at
    assert hand.state.freshness == int(looked_at)
    assert (hand.state.command_ms == hand.now_ms) == looked_at


@requirement("P6")
def test_an_authorisation_without_a_session_or_without_a_command_is_nothing() -> None:
    hand = Hand().to_ready()
    command = hand.act_cmd(frames.GATE_ACT, 1)
    right = hand.auth(command)
    fed_ms = hand.state.command_ms
    hand.tick(right)
    assert (hand.state.command_ms, hand.state.freshness, hand.count(Reject.AUTH_UNPAIRED)) == (fed_ms, 0, 1)
    hand.tick(command, hand.hold(), hand.auth(command))
    assert hand.state.command_is_hold
    assert hand.state.freshness == 2
    hand = Hand().to_follow()
    command = hand.act_cmd(frames.GATE_ACT, 1)
    hand.tick(command, hand.auth(command))
    assert hand.count(Reject.AUTH_UNPAIRED) == 1
    assert not hand.state.command_live


@requirement("P6")
@pytest.mark.parametrize(("gap_ms", "looked_at"), [(10, False), (11, True)])
def test_commands_are_remembered_for_the_ten_milliseconds_of_an_authorisation(gap_ms: int, looked_at: bool) -> None:
    hand = Hand().to_ready()
    hand.tick(*[hand.act_cmd(frames.GATE_ACT, 1) for _ in range(4)])
    hand.run(gap_ms - 1)
    hand.tick(*hand.act())
    assert (hand.state.state is State.ASSIST) == looked_at


@requirement("P6", "S6")
def test_h1_a_wrong_mac_beside_a_disturbed_pair_is_still_a_failure() -> None:
    hand = Hand().to_ready()
    for _ in range(3):
        command = hand.act_cmd(frames.GATE_ACT, 1)
        wrong = hand.auth(command, key=b"not the true key")
        hand.beat(command, hand.act_cmd(frames.GATE_ACT, 10), wrong, milliseconds=12)
    assert hand.state.state is State.LATCHED
