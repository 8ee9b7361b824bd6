"""hilscenario.live.intruder: a third node on a given clock sends at its rate and only while it should."""

from __future__ import annotations

import time
from typing import Any

import can
import pytest

from firmware_sim import frames as layout
from firmware_sim.attachment import parse_spec as device_spec
from hilscenario.format.schema import Step
from hilscenario.live.intruder import LiveIntruder
from hilscenario.world.fault_board import Active

MS = 1_000_000


@pytest.fixture
def other() -> Any:
    bus = can.Bus(interface="virtual", channel="intruder-test")
    yield bus
    bus.shutdown()


def heard(bus: can.BusABC) -> list[int]:
    found = []
    while (message := bus.recv(0)) is not None:
        found.append(message.arbitration_id)
    return found


def active(fault: str, **options: float) -> Active:
    return Active(Step.model_validate({"fault": fault, "at": "1 ms", "with": options}))


def test_the_intruder_sends_stop_three_times_babbles_and_forges_at_its_rate(other: can.BusABC) -> None:
    intruder = LiveIntruder(device_spec("virtual:intruder-test"), 1)
    stop, babble, forge = active("bus.stop"), active("bus.babble", per_s=1000), active("bus.forge", per_s=50)
    intruder.begin(stop, 0)
    intruder.end(stop)  # an instant is over at once; its three frames are not
    for now_ms in range(0, 40, 5):
        intruder.poll(now_ms * MS)
    assert heard(other) == [layout.STOP] * 3
    assert stop.effects == 3
    intruder.begin(babble, 0)
    for now_ms in range(0, 41, 4):
        intruder.poll(now_ms * MS)
    intruder.end(babble)
    intruder.poll(50 * MS)
    assert len(heard(other)) == babble.effects == 40
    intruder.begin(forge, 0)
    for now_ms in range(0, 100, 4):
        intruder.poll(now_ms * MS)
    intruder.end(forge)
    pairs = heard(other)
    assert pairs[:2] == [layout.ACT_CMD, layout.ACT_AUTH]
    assert len(pairs) == forge.effects == 10
    intruder.close()


def test_the_intruder_replays_what_it_heard_in_its_rhythm(other: can.BusABC) -> None:
    intruder = LiveIntruder(device_spec("virtual:intruder-test"), 1)
    for can_id in (layout.ACT_CMD, 0x7FF):  # of the bridge, and of nobody that matters
        other.send(can.Message(arbitration_id=can_id, data=b"12345678", is_extended_id=False))
    now_ns = time.monotonic_ns()
    intruder.poll(now_ns)
    replay = active("bus.replay", past_s=1.0)
    intruder.begin(replay, now_ns + 500 * MS)
    intruder.poll(now_ns + 900 * MS)
    assert heard(other) == []
    intruder.poll(now_ns + 1001 * MS)
    assert heard(other) == [layout.ACT_CMD]
    assert replay.effects == 1
    intruder.close()
