"""The two codecs, one contract: random values both ways, random bytes judged alike, golden frames."""

from __future__ import annotations

import json
import random
import sys
from pathlib import Path
from typing import Any

from firmware_sim import e2e as device_e2e
from firmware_sim import frames
from firmware_sim.frames import FIELDS, Reject
from hilbridge.records import Frame
from hilbridge.wire.codec import Codec, Decoded, Rejected
from hilbridge.wire.dbc import Message, Signal
from hilbridge.wire.e2e import protect
from tests.safety.table import Row, Scale

GOLDEN = Path(__file__).parents[3] / "dbc" / "golden_frames.json"
GOLDEN_PER_MESSAGE = 8


def fields_of(layout: Message, values: tuple[int, ...]) -> tuple[Signal, ...]:
    """The DBC's signals in the order of the device's fields for this multiplexer value."""
    if layout.multiplexer is None:
        return layout.signals
    return (layout.multiplexer, *layout.groups[values[0]])


def random_values(can_id: int, rng: random.Random) -> tuple[int, ...]:
    """Raw values the device's codec allows, the ends of their ranges often."""
    values = []
    for field in FIELDS[can_id]:
        if field.allowed is not None:
            values.append(rng.choice(field.allowed))
        elif rng.random() < 0.2:
            values.append(rng.choice((field.lowest, field.highest)))
        else:
            values.append(rng.randint(field.lowest, field.highest))
    return tuple(values)


def signals_of(layout: Message, values: tuple[int, ...]) -> dict[str, Any]:
    """The same as the bridge says it: names and physical values."""
    signals: dict[str, Any] = {}
    for signal, raw in zip(fields_of(layout, values), values, strict=True):
        signals[signal.name] = signal.names[raw] if signal.names is not None else raw * signal.scale + signal.offset
    return signals


def both_ways(codec: Codec, count: int, seed: int) -> int:
    """How many of `count` random values do not survive device -> bridge and bridge -> device."""
    rng, ids, differ = random.Random(seed), sorted(FIELDS), 0
    for k in range(count):
        can_id = ids[k % len(ids)]
        layout = codec.by_id[can_id]
        values = random_values(can_id, rng)
        signals = signals_of(layout, values)
        data = frames.pack(can_id, values)
        if k & 1:
            heard = codec.decode(Frame(can_id, data))
            differ += not isinstance(heard, Decoded) or heard.signals != signals
        else:
            differ += codec.encode(layout.name, signals) != data or frames.unpack(can_id, data) != (
                Reject.ACCEPTED,
                values,
            )
    return differ


def judged_alike(codec: Codec, count: int, seed: int) -> int:
    """How many of `count` random frames one end takes and the other does not, or refuses for another reason."""
    rng, ids, differ = random.Random(seed), sorted(FIELDS), 0
    for k in range(count):
        can_id = ids[k % len(ids)] if rng.random() < 0.95 else rng.randrange(2, 0x800)
        data = bytearray(rng.randbytes(8))
        if can_id in FIELDS and rng.random() < 0.7:
            data = bytearray(frames.pack(can_id, random_values(can_id, rng)))
            data[3 + rng.randrange(5)] ^= 1 << rng.randrange(8)
        frame = bytes(data) if rng.random() < 0.97 else bytes(data[: rng.randrange(8)])
        why, _ = frames.unpack(can_id, frame)
        outcome = codec.decode(Frame(can_id, frame))
        mine = "ACCEPTED" if isinstance(outcome, Decoded) else outcome.reason.name
        differ += not _same_reason(mine, why.name, isinstance(outcome, Rejected))
    return differ


def _same_reason(bridge: str, device: str, rejected: bool) -> bool:
    # A frame may be wrong in two ways; the ends look at its fields in different orders.
    if rejected != (device != "ACCEPTED"):
        return False
    content = {"RANGE", "ENUM", "MUX", "RESERVED"}
    return bridge == device or {bridge, device} <= content


def golden_now(codec: Codec) -> list[dict[str, Any]]:
    """Golden frames: named signals and the protected bytes they make, a handful of every message."""
    entries: list[dict[str, Any]] = [{"message": "STOP", "id": 1, "counter": 0, "signals": {}, "data": ""}]
    rng = random.Random(5)
    for can_id in sorted(FIELDS):
        layout = codec.by_id[can_id]
        for k in range(GOLDEN_PER_MESSAGE):
            values = random_values(can_id, rng)
            counter = (k * 37) & 0xFF
            signals = signals_of(layout, values)
            data = protect(codec.encode(layout.name, signals), layout.data_id or 0, counter)
            entries.append(
                {"message": layout.name, "id": can_id, "counter": counter, "signals": signals, "data": data.hex()}
            )
    return entries


def golden_differ(codec: Codec) -> tuple[int, int]:
    """(golden frames committed, those that either end no longer makes and reads)."""
    entries, differ = json.loads(GOLDEN.read_text()), 0
    for entry in entries:
        data = bytes.fromhex(entry["data"])
        layout = codec.messages[entry["message"]]
        heard = codec.decode(Frame(entry["id"], data))
        differ += not isinstance(heard, Decoded) or heard.signals != entry["signals"]
        if layout.data_id is None:
            differ += codec.encode("STOP", {}) != data
            continue
        made = protect(codec.encode(layout.name, entry["signals"]), layout.data_id, entry["counter"])
        why, values = frames.unpack(entry["id"], data)
        packed = device_e2e.protect(entry["id"], frames.pack(entry["id"], values), entry["counter"])
        differ += made != data or why != Reject.ACCEPTED or packed != data
    return len(entries), differ


def run(scale: Scale) -> list[Row]:
    """All of it."""
    codec = Codec()
    values, judged = scale.of(1_000_000, 40_000), scale.of(500_000, 20_000)
    differ, judged_differ = both_ways(codec, values, scale.seed), judged_alike(codec, judged, scale.seed)
    golden, golden_wrong = golden_differ(codec)
    return [
        Row("conformance", "random values, both directions, every message", f"{values}, {differ} differ", differ == 0),
        Row(
            "conformance",
            "random bytes judged alike by both codecs",
            f"{judged}, {judged_differ} differ",
            judged_differ == 0,
        ),
        Row(
            "conformance",
            "golden frames made and read by both ends",
            f"{golden}, {golden_wrong} differ",
            golden_wrong == 0,
        ),
    ]


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps(golden_now(Codec()), indent=1) + "\n")
    print(f"{GOLDEN} written", file=sys.stderr)
