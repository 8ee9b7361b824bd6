"""Fuzzing of decode on both ends: no exception, and nothing invalid feeds a watchdog.

With atheris (the extra `safety`) the inputs are guided by coverage; without it, and in the quick run, by a seeded
generator that knows how to make frames almost right. The oracle of "valid" is the library autosar-e2e.
"""

from __future__ import annotations

import importlib.util
import os
import random
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from types import FunctionType

import e2e as autosar

from firmware_sim import frames
from firmware_sim.e2e import DATA_ID, Machine
from firmware_sim.e2e import protect as device_protect
from firmware_sim.memory import Received
from firmware_sim.receive import receive
from hilbridge.core.bridge import Bridge, BridgeConfig
from hilbridge.records import Frame
from hilbridge.wire.codec import Decoded
from hilbridge.wire.keys import DEMO_KEY
from hilbridge.wire.link import WireLink
from hilbridge.wire.secoc import Authenticator
from tests.safety.hand import Hand
from tests.safety.rig import codec
from tests.safety.stepping import copied
from tests.safety.table import Row, Scale

_IDS = (*frames.RECEIVED_IDS, *frames.OWN_IDS, frames.STOP, 0x7FF)
_POISED = Hand().to_ready()
_NOW_MS = _POISED.now_ms + 1


class Invalid(AssertionError):
    """Something that is no valid frame has fed a watchdog."""


def frame_of(data: bytes) -> tuple[int, bytes, bool]:
    """Fuzzer's bytes -> (identifier, frame, plain): often with the right CRC and counter, or nearly right."""
    if len(data) < 2:
        return 0x60, data, True
    can_id, how, body = _IDS[data[0] % len(_IDS)], data[1], data[2:66]
    if how & 1 and can_id in DATA_ID and len(body) >= 5:
        counter = body[5] if how & 2 and len(body) > 5 else _next_counter(can_id)
        body = device_protect(can_id, bytes(3) + body[:5], counter)
        if how & 4:  # right in all but one bit of its CRC
            bit = how >> 3 & 15
            body = bytes((body[0] ^ (1 << bit & 0xFF), body[1] ^ (1 << bit >> 8))) + body[2:]
    return can_id, body, not how & 0x80


def _next_counter(can_id: int) -> int:
    if can_id in frames.RECEIVED_IDS:
        last = _POISED.state.receivers[frames.RECEIVED_IDS.index(can_id)].counter
        return 1 if last is None else (last + 1) & 0xFF
    return 1


def device_takes(can_id: int, body: bytes, plain: bool) -> None:
    """One frame into an armed, READY device. Raises Invalid, or whatever the code raises."""
    state = copied(_POISED.state)
    receive(state, Received(can_id, body, plain), 7, _NOW_MS)
    fed = state.command_ms == _NOW_MS or state.heartbeat_ms == _NOW_MS
    if fed:
        valid = plain and len(body) == 8 and can_id in DATA_ID and autosar.p05.e2e_p05_check(body, DATA_ID[can_id])
        if not valid or can_id not in (frames.ACT_CMD, frames.BRIDGE_HB, frames.ARM_RESPONSE):
            raise Invalid(f"device: {can_id:03X} {body.hex()} fed a watchdog")
    if state.state.name == "ASSIST":
        raise Invalid(f"device: one frame {can_id:03X} {body.hex()} started an assist")


def bridge_takes(can_id: int, body: bytes, plain: bool) -> None:
    """One frame into a fresh bridge. Raises Invalid, or whatever the code raises."""
    link = WireLink(codec())
    bridge = Bridge(link, Authenticator(DEMO_KEY), lambda: 1, BridgeConfig(), lambda: link.counters)
    outcome = link.decode(Frame(can_id, body, is_extended=not plain))
    if isinstance(outcome, Decoded):
        bridge.on_message(outcome.name, outcome.signals, outcome.counter, 1)
        protected = outcome.name != "STOP"
        if protected and not (plain and autosar.p05.e2e_p05_check(body, DATA_ID[can_id])):  # a STOP counts in any form
            raise Invalid(f"bridge: {can_id:03X} {body.hex()} was taken")
    elif bridge.device is not None:
        raise Invalid(f"bridge: {can_id:03X} {body.hex()} rejected, yet a status")
    if link.machine("CTRL_STATUS").name == Machine.INVALID.name:
        raise Invalid("bridge: one frame made a fresh machine invalid")


def one_input(data: bytes) -> None:
    """What the fuzzer calls."""
    can_id, body, plain = frame_of(data)
    device_takes(can_id, body, plain)
    bridge_takes(can_id, body, plain)


def seeded(count: int, seed: int) -> Row:
    """Without coverage guidance."""
    rng, raised = random.Random(seed), 0
    for _ in range(count):
        data = rng.randbytes(rng.choice((0, 1, 2, 7, 8, 9, 10, 10, 10, 20)))
        try:
            one_input(data)
        except Exception as error:  # any exception at all is a finding
            raised += 1
            print(f"{data.hex()}: {error!r}", file=sys.stderr)
    claim = "decode on both ends, seeded inputs: no exception, nothing invalid feeds"
    return Row("fuzz", claim, f"{count} inputs, {raised} raised", raised == 0)


def guided(count: int, seed: int) -> Row:
    """With atheris, in a process of its own (libFuzzer ends its process)."""
    with tempfile.TemporaryDirectory() as corpus:
        command = [
            sys.executable,
            "-m",
            "tests.safety.wire.fuzz",
            f"-runs={count}",
            f"-seed={seed}",
            "-max_len=66",
            corpus,
        ]
        environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    found = re.search(r"Done (\d+) (?:runs )?in (\d+) second", done.stderr)
    runs = int(found[1]) if found else 0
    if done.returncode:
        print(done.stderr[-2000:], file=sys.stderr)
    return Row(
        "fuzz",
        "decode on both ends, atheris: no exception, nothing invalid feeds",
        f"{runs} inputs, exit {done.returncode}",
        runs >= count and done.returncode == 0,
    )


def run(scale: Scale) -> list[Row]:
    """Seeded always; guided by coverage in the full run, where a missing atheris is a failure."""
    rows = [seeded(scale.of(500_000, 20_000), scale.seed)]
    if scale.quick:
        return rows
    if importlib.util.find_spec("atheris") is None:
        return [*rows, Row("fuzz", "atheris", "not installed: pip install 'hilbridge[safety]'", False)]
    return [*rows, guided(scale.of(10_000_000, 100_000), scale.seed)]


if __name__ == "__main__":
    import atheris

    import firmware_sim.e2e
    import firmware_sim.frames
    import firmware_sim.receive
    import hilbridge.wire.codec
    import hilbridge.wire.link

    for module in (
        firmware_sim.frames,
        firmware_sim.receive,
        firmware_sim.e2e,
        hilbridge.wire.codec,
        hilbridge.wire.link,
    ):
        for thing in list(vars(module).values()):
            if getattr(thing, "__module__", "") != module.__name__:
                continue
            for function in (thing, *(vars(thing).values() if isinstance(thing, type) else ())):
                if isinstance(function, FunctionType):
                    atheris.instrument_func(function)
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
