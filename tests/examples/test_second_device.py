"""examples/second_device.py: a device written from docs/protocol.md alone arms, acts, holds and stops with the bridge."""

from __future__ import annotations

import importlib.util
import json
import random
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import can
import pytest

from firmware_sim import frames
from firmware_sim.frames import FIELDS, Reject
from hilbridge.limits import MS
from hilbridge.records import Frame, GateDecision
from hilbridge.wire.codec import Decoded
from tests.safety.rig import ACT_POUR, ACT_TAKE, HOLD, Rig, codec
from tests.safety.wire.conformance import random_values

ROOT = Path(__file__).parents[2]
EXAMPLE, DBC = ROOT / "examples" / "second_device.py", str(ROOT / "dbc" / "iassistadl.dbc")


def load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("second_device", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["second_device"] = module
    spec.loader.exec_module(module)
    return module


second = load()


def message(can_id: int, data: bytes, **kind: bool) -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, **{"is_extended_id": False, **kind})


class Bench(Rig):
    """The bridge's core of the rig, and the second device in place of the first."""

    def __init__(self, key: bytes | None = None) -> None:
        super().__init__(**({} if key is None else {"key": key}))
        self.device = second.Device(DBC)

    def step(self, milliseconds: int, decision: GateDecision | None = None) -> Bench:
        self.decision = decision or self.decision
        for _ in range(milliseconds):
            self.now_ms += 1
            now_ns = self.now_ms * MS
            if self.bridge_runs and self.now_ms % 40 == 0:
                self.bridge.begin_tick(now_ns)
                self._bridge_sends(self.bridge.tick(self.decision, now_ns - 20 * MS, (True, True, True), 7, now_ns))
            queue, self._queue = self._queue, []
            answers = [answer for frame in queue for answer in self.device.receive(message(frame.can_id, frame.data))]
            for can_id, data in answers + self.device.tick(self.now_ms):
                if self.bridge_runs:
                    self._bridge_hears(frames_received(can_id, data), now_ns)
        return self


def frames_received(can_id: int, data: bytes) -> Frame:
    return Frame(can_id, data)


@pytest.fixture
def assisting() -> Bench:
    bench = Bench().step(3000)
    assert bench.device.state == second.READY
    bench.step(400, ACT_POUR)
    assert bench.device.state == second.ASSIST
    return bench


def test_it_is_short_and_needs_nothing_of_this_project() -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    assert len([line for line in text.splitlines() if line.strip()]) <= 300
    assert "import hilbridge" not in text
    assert "from hilbridge" not in text
    assert "firmware_sim" not in text


def test_it_arms_acts_and_holds(assisting: Bench) -> None:
    assert assisting.bridge.session.armed
    assert assisting.device.verb == 10
    assert assisting.device.assist == 1.0
    assisting.step(100, HOLD)
    assert (assisting.device.state, assisting.device.assist) == (second.READY, 0.0)
    assisting.step(200, ACT_TAKE)
    assert (assisting.device.state, assisting.device.verb) == (second.ASSIST, 1)
    assert assisting.device.counters["RejMac"] == 0


def test_a_change_of_verb_goes_through_ready(assisting: Bench) -> None:
    assisting.step(400, ACT_TAKE)
    assert (assisting.device.state, assisting.device.verb) == (second.ASSIST, 1)


def test_silence_takes_assist_down_in_time(assisting: Bench) -> None:
    assisting.bridge_runs = False
    silent_ms = assisting.device.command_ms
    while assisting.device.assist:
        assisting.step(1)
    assert assisting.now_ms - silent_ms <= 150
    assert assisting.device.state in (second.RAMP_DOWN, second.FOLLOW)
    assert assisting.step(5).device.state == second.FOLLOW


def test_stop_in_any_form_takes_assist_down_in_20_ms(assisting: Bench) -> None:
    assisting.device.receive(message(0x001, b"", is_remote_frame=True))
    assisting.bridge_runs = False
    assert assisting.step(20).device.assist == 0.0
    assert assisting.device.state == second.ESTOP


def test_another_key_gets_no_session() -> None:
    bench = Bench(b"another key here").step(6000, ACT_TAKE)
    assert not bench.device.session
    assert bench.device.state in (second.FOLLOW, second.LATCHED)
    assert bench.device.counters["RejMac"] >= 1


def golden() -> Iterator[dict[str, object]]:
    yield from json.loads((ROOT / "dbc" / "golden_frames.json").read_text())


def test_it_makes_and_reads_the_golden_frames() -> None:
    wire, checked = second.Wire(DBC), 0
    for entry in golden():
        can_id, data = int(str(entry["id"])), bytes.fromhex(str(entry["data"]))
        if can_id == second.STOP:
            continue
        assert second.crc16(can_id, data[2:]) == data[:2]
        decoded = wire.messages[can_id].decode(data, decode_choices=False, scaling=False)
        raw = {name: value for name, value in decoded.items() if name not in ("CRC", "Counter")}
        masked = {name: int(value) & 0xFFFFFFFF for name, value in raw.items()}
        assert wire.encode(can_id, int(str(entry["counter"])), **{k: int(v) for k, v in raw.items()}) == data, masked
        checked += 1
    assert checked == 96


def test_random_frames_are_judged_as_the_other_device_judges_them() -> None:
    device, chance, differ = second.Device(DBC), random.Random(5), []
    names = {"ACCEPTED": "RxAccepted"}
    ids = sorted(second.MAX_DELTA)
    for number in range(20_000):
        can_id = chance.choice(ids)
        data = bytearray(frames.pack(can_id, random_values(can_id, chance)))
        for _ in range(chance.randrange(3)):
            data[3 + chance.randrange(5)] ^= 1 << chance.randrange(8)
        data[2] = number & 0xFF
        data[:2] = second.crc16(can_id, bytes(data[2:]))
        signals = device.wire.read(can_id, bytes(data))
        why, _ = frames.unpack(can_id, bytes(data))
        mine = signals if isinstance(signals, str) else "RxAccepted"
        theirs = names.get(why.name, "Rej" + "".join(part.capitalize() for part in why.name.split("_")))
        same = mine == theirs or {mine, theirs} <= {"RejRange", "RejEnum", "RejMux", "RejReserved"}
        if not same:
            differ.append((hex(can_id), bytes(data).hex(), mine, theirs))
    assert differ == []
    assert set(FIELDS) >= set(ids)
    assert Reject.ACCEPTED.name == "ACCEPTED"


def test_its_frames_are_the_bridges_to_read() -> None:
    bench = Bench().step(2000)
    assert bench.wire.counters["LostFrames"] == 0
    assert all(not count for name, count in bench.wire.counters.items() if name.startswith("Rej"))
    status = codec().decode(Frame(0x0A0, bench.device._send(0x0A0, State=2)[1]))
    assert isinstance(status, Decoded)
