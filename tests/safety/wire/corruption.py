"""Every one- to four-bit error of a frame, on both ends; AUTOSAR's vectors; two libraries from outside."""

from __future__ import annotations

import random
from itertools import combinations
from typing import Any

import cantools
import e2e as autosar
from crccheck.crc import Crc16CcittFalse

from firmware_sim import e2e as device
from firmware_sim.frames import ACT_CMD
from hilbridge.wire import e2e as bridge
from hilbridge.wire.dbc import default_dbc_path
from tests.safety.table import Row, Scale

DATA_ID = device.DATA_ID[ACT_CMD]
ONE_TO_THREE = 64 + 2016 + 41664
FOUR = 635_376


def _undetected(bits: int, word: int) -> tuple[int, set[int], set[int]]:
    """(patterns tried, those the device takes, those the bridge takes) for errors of exactly `bits` bits."""
    tried, device_takes, bridge_takes = 0, set(), set()
    masks = [1 << bit for bit in range(64)]
    for chosen in combinations(masks, bits):
        pattern = sum(chosen)
        data = (word ^ pattern).to_bytes(8, "little")
        tried += 1
        if device.frame_crc(ACT_CMD, data) == data[0] | data[1] << 8:
            device_takes.add(pattern)
        if bridge.crc(data, DATA_ID) == data[0] | data[1] << 8:
            bridge_takes.add(pattern)
    return tried, device_takes, bridge_takes


def exhaustive() -> list[Row]:
    """All errors of one to four bits of one frame; the CRC is linear, so they are those of every frame."""
    good = device.protect(ACT_CMD, bytes.fromhex("0000005a3c99e107"), 77)
    word = int.from_bytes(good, "little")
    tried = missed = 0
    for bits in (1, 2, 3):
        found, by_device, by_bridge = _undetected(bits, word)
        tried += found
        missed += len(by_device) + len(by_bridge)
    four, by_device, by_bridge = _undetected(4, word)
    other = int.from_bytes(device.protect(ACT_CMD, bytes.fromhex("000000ffffffff3f"), 200), "little")
    same = all(
        device.frame_crc(ACT_CMD, data) == data[0] | data[1] << 8
        for data in ((other ^ pattern).to_bytes(8, "little") for pattern in by_device)
    )
    return [
        Row(
            "corruption",
            f"all {ONE_TO_THREE} errors of 1-3 bits rejected, both ends",
            f"{tried} tried, {missed} taken",
            tried == ONE_TO_THREE and missed == 0,
        ),
        Row(
            "corruption",
            f"of {FOUR} four-bit errors exactly 64 unseen, the same on both ends",
            f"{four} tried, device {len(by_device)}, bridge {len(by_bridge)}, same {by_device == by_bridge and same}",
            four == FOUR and len(by_device) == 64 and by_device == by_bridge and same,
        ),
    ]


def agreement(count: int, seed: int) -> list[Row]:
    """Random frames through four implementations: device, bridge, autosar-e2e, and cantools + crccheck."""
    database: Any = cantools.database.load_file(str(default_dbc_path()))
    protected = [m for m in database.messages if m.length == 8]
    rng = random.Random(seed)
    differ = 0
    for _ in range(count):
        message = rng.choice(protected)
        data_id = message.dbc.attributes["E2EDataId"].value
        counter, payload = rng.randrange(256), bytes(3) + rng.randbytes(5)
        mine = bridge.protect(payload, data_id, counter)
        theirs = device.protect(message.frame_id, payload, counter)
        library = bytearray(payload)
        library[2] = counter
        autosar.p05.e2e_p05_protect(library, data_id, increment_counter=False)
        crc = Crc16CcittFalse.calc(mine[2:] + data_id.to_bytes(2, "little"))
        signals = {s.name: s for s in message.signals}
        raw = int.from_bytes(mine, "little")
        by_dbc = (
            (raw >> signals["CRC"].start) & 0xFFFF,
            (raw >> signals["Counter"].start) & 0xFF,
        )
        agree = mine == theirs == bytes(library) and by_dbc == (crc, counter)
        agree = agree and autosar.p05.e2e_p05_check(mine, data_id)
        broken = bytearray(mine)
        broken[rng.randrange(8)] ^= 1 << rng.randrange(8)
        agree = agree and not autosar.p05.e2e_p05_check(bytes(broken), data_id)
        agree = agree and bridge.crc(bytes(broken), data_id) != int.from_bytes(broken[:2], "little")
        agree = agree and device.frame_crc(message.frame_id, bytes(broken)) != int.from_bytes(broken[:2], "little")
        differ += not agree
    vector = bridge.protect(bytes(8), 0x1234, 0).hex()
    return [
        Row(
            "corruption",
            "autosar-e2e, crccheck and cantools' layout agree",
            f"{count} frames, {differ} differ",
            differ == 0,
        ),
        Row("corruption", "profile-5 vector (Data ID 0x1234, zeros)", vector, vector == "1cca000000000000"),
    ]


def run(scale: Scale) -> list[Row]:
    """All of it; the exhaustive part takes ten seconds."""
    return exhaustive() + agreement(scale.of(40_000, 20_000), scale.seed)
