"""The reference port on an emulated Cortex-M4: in real time with the bridge's own machine, and in its own time, ms by ms."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from firmware_sim.states import State
from hilbridge.conformance.bus_line import BusLine
from hilbridge.conformance.findings import Verdict
from hilbridge.conformance.plan import CASES, conduct
from hilbridge.conformance.tester import ByHand, Setting
from hilbridge.records import Action, Frame, GateDecision, HoldReason
from hilbridge.wire.codec import Codec
from hilbridge.wire.keys import DEMO_KEY
from hilbridge.wire.secoc import Authenticator
from tests.safety.rig import ACT_POUR, HOLD
from tests.system.emulated.board import MISSING, Board, emulated
from tests.system.emulated.bridge_by_hand import BridgeByHand
from tests.system.emulated.granted import GrantedLine

pytestmark = pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)}")
ACT_OPERATE = GateDecision(Action.ACT, 13, 0.9, HoldReason.NONE)
STOP = Frame(0x001, b"")
OWN = Frame(0x0A0, bytes(8))  # CTRL_STATUS from elsewhere latches, and a latch may be cleared by a handshake
OPTIONS = {"bitrate": 500_000, "sleep_after_open": 0}
PHASES = 100
# One instruction is 8 ns of the emulator's time, and a count of SysTick 40 ns.
ICOUNT = ("-icount", "shift=3")
INSTRUCTIONS = 5
TENTH_OF_A_MS = 16_800  # instructions at 168 MHz, one a cycle


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[tuple[Board, GrantedLine]]:
    with emulated(tmp_path, *ICOUNT, lab=True) as board, closing(GrantedLine(board)) as line:
        yield board, line


def worst_tick(board: Board) -> int:
    """Instructions of the longest ctl_step so far."""
    return max(int(line[2], 16) for line in board.told if line[0] == "W") * INSTRUCTIONS


@pytest.mark.timeout(300)
def test_in_real_time_it_boots_arms_acts_holds_and_stops(tmp_path: Path) -> None:
    with emulated(tmp_path) as board, BusLine(board.spec, OPTIONS) as line:
        bridge = BridgeByHand(line)
        bridge.until(bridge.is_in(State.READY), "boots and arms")
        bridge.decision = ACT_OPERATE
        bridge.until(bridge.assists, "acts")
        bridge.decision = HOLD
        bridge.until(lambda: bridge.state is State.READY and bridge.assist_zero, "holds")
        bridge.decision = ACT_POUR
        bridge.until(bridge.is_in(State.ASSIST), "acts again")
        bridge.speaks = False  # a hung bridge
        bridge.until(lambda: bridge.state is State.FOLLOW and bridge.assist_zero, "falls back to following")
        bridge.speaks, bridge.decision = True, HOLD
        bridge.until(bridge.is_in(State.READY), "is armed anew")
        line.send(STOP)
        bridge.until(bridge.is_in(State.ESTOP), "stops")
        assert bridge.assist_zero


@pytest.mark.timeout(600)
def test_it_keeps_every_claim_and_a_tick_of_an_honest_bridge_takes_a_tenth_of_a_millisecond(
    lab: tuple[Board, GrantedLine],
) -> None:
    board, line = lab
    bridge = BridgeByHand(line)
    bridge.until(bridge.is_in(State.READY), "arms")
    bridge.decision = ACT_POUR
    bridge.until(bridge.assists, "acts")
    bridge.run(5_000.0)
    honest = worst_tick(board)
    print(f"an honest bridge: {honest} instructions in the longest tick")
    assert honest <= TENTH_OF_A_MS
    setting = Setting(Authenticator(DEMO_KEY), random.Random(3), 2.0, 20, board.press)
    findings = conduct(ByHand(line, Codec(), setting), CASES)
    assert [finding for finding in findings if finding.verdict is not Verdict.KEPT] == []
    print(f"the whole plan: {worst_tick(board)} instructions in the longest tick")
    assert worst_tick(board) <= TENTH_OF_A_MS


@pytest.mark.timeout(600)
def test_no_flood_makes_a_tick_longer_than_a_tenth_of_a_millisecond(lab: tuple[Board, GrantedLine]) -> None:
    """Four frames a ms are all that 500 kbit/s carry, ten where they are empty."""
    board, line = lab
    tester = ByHand(line, Codec(), Setting(Authenticator(DEMO_KEY), random.Random(3), 2.0, 1, board.press))
    tester.to_ready()
    for _ in range(50):
        for _ in range(4):  # commands that any MAC may be for
            tester.send(tester.command("Pour"))
            tester.run(1.0)
        for _ in range(4):
            command = tester.command("Pour")
            tester.send(*(tester.authorisation(command, flip=5) for _ in range(4)))
            tester.run(1.0)
        tester.run(12.0)
    print(f"a flood of ACT_AUTH: {worst_tick(board)} instructions in the longest tick")
    tester.send(OWN)
    tester.run(100.0)
    before = tester.counts("RejMac")["RejMac"]
    for number in range(tester.session + 1, tester.session + 101, 2):
        tester.send(*guessed_handshake(tester, number), *guessed_handshake(tester, number + 1))
        tester.run(1.0)
    assert tester.counts("RejMac")["RejMac"] == before + 50  # one of the two in each ms is looked at
    print(f"and of handshakes: {worst_tick(board)} instructions in the longest tick")
    for _ in range(50):
        tester.send(*[STOP] * 10)
        tester.run(1.0)
    print(f"and of STOP: {worst_tick(board)} instructions in the longest tick")
    assert worst_tick(board) <= TENTH_OF_A_MS


def guessed_handshake(tester: ByHand, session: int) -> tuple[Frame, Frame]:
    """A request, and a response of this session to the challenge that nobody has read."""
    request = tester.frame("ARM_REQUEST", {"BridgeNonce": 1, "Purpose": "ClearLatch"})
    return request, tester.frame("ARM_RESPONSE", {"Mac": 7, "Session": session})


@pytest.mark.timeout(600)
@pytest.mark.parametrize(("ending", "limit_ms"), [("hung", 150), ("hold", 60), ("stop", 20)])
def test_assist_ends_in_time_on_its_own_clock(lab: tuple[Board, GrantedLine], ending: str, limit_ms: int) -> None:
    board, line = lab
    bridge, chance = BridgeByHand(line), random.Random(ending)
    took_ms = [one_ending(board, bridge, ending, chance) for _ in range(PHASES)]
    print(f"{ending}: zero assist after at most {max(took_ms)} ms of the board's own time, {PHASES} phases")
    assert max(took_ms) <= limit_ms


def one_ending(board: Board, bridge: BridgeByHand, ending: str, chance: random.Random) -> int:
    """Assist, end it at a random phase; from the reason, as it came to the board, to zero assist: ms of its own."""
    bridge.speaks, bridge.decision = True, HOLD
    if bridge.state in (State.LATCHED, State.ESTOP):
        bridge.bridge.request_clear_latch()
        bridge.run(900.0)
        board.press()
    bridge.until(bridge.is_in(State.READY), "arms")
    bridge.decision = ACT_POUR
    bridge.until(bridge.assists, "acts")
    bridge.run(chance.uniform(0.0, 120.0))
    bridge.until(bridge.assists, "acts on")
    told = len(board.told)
    if ending == "hung":
        bridge.speaks = False
    elif ending == "hold":
        bridge.decision = HOLD
    else:
        bridge.line.send(STOP)
        bridge.speaks = False
    bridge.run(250.0)
    column = {"hung": 4, "hold": 5, "stop": 6}[ending]
    changes = [[int(number, 16) for number in line[1:]] for line in board.told[told:] if line[0] == "L"]
    zero = [now_ms - line[column - 1] for line in changes for now_ms in line[:1] if line[2]]
    assert zero, f"no zero assist after {ending}: {changes}"
    return zero[-1]
