"""The parts of docs/protocol.md that repeat the code: tables from the DBC, worked numbers from both ends.

`python -m tests.tools.protocol_page` writes them into the page; tests/house/test_docs.py fails where the page differs.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cantools

from firmware_sim import e2e, frames, secoc, transmit, watchdogs
from firmware_sim.frames import Reject
from firmware_sim.states import Event, Reason, State
from firmware_sim.transitions import SELF_TEST_MS
from hilbridge import limits
from hilbridge.wire.codec import Codec
from hilbridge.wire.dbc import default_dbc_path
from hilbridge.wire.secoc import Authenticator

PAGE = Path(__file__).parents[2] / "docs" / "protocol.md"
_BLOCK = re.compile(r"(<!-- from the code: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

# Of the handshake that the page works through.
BRIDGE_NONCE, DEVICE_NONCE, BOOT_NONCE, SESSION = 0x11223344, 0x55667788, 0x99AABBCC, 7

_MEANING = {
    Reject.ACCEPTED: "taken in whole",
    Reject.LENGTH: "not 8 bytes",
    Reject.RANGE: "a value outside its range, or another protocol version in BRIDGE_HB",
    Reject.MUX: "a multiplexer value that the message does not have",
    Reject.ENUM: "a value that is not in the signal's value table",
    Reject.RESERVED: "an unused bit that is not 0",
    Reject.UNKNOWN_ID: "an identifier that this node does not receive",
    Reject.KIND: "an error, remote, extended or FD frame",
    Reject.CRC: "CRC wrong (also: wrong Data ID)",
    Reject.REPEATED: "the same counter again",
    Reject.SEQUENCE: "the counter jumped by more than MaxDelta",
    Reject.E2E_STATE: "an ACT while the machine of ACT_CMD is not VALID",
    Reject.SESSION: "an ACT with the number of another session",
    Reject.NOT_ARMED: "an ACT without a session",
    Reject.ECHO: "an ACT whose echo is unknown or older than 100 ms",
    Reject.AGE: "an ACT on sensing older than 150 ms, or of unknown age",
    Reject.VERB: "an ACT for a verb that is never assisted",
    Reject.AUTH_MISSING: "an ACT without its ACT_AUTH in time, or overtaken by the next ACT_CMD",
    Reject.AUTH_UNPAIRED: "an ACT_AUTH without a waiting ACT, or right for one that waits no longer",
    Reject.MAC: "a MAC that is wrong, of ACT_AUTH or ARM_RESPONSE",
    Reject.HANDSHAKE: "an ARM_REQUEST in the wrong state, an ARM_RESPONSE too late or without a challenge",
}


def _database() -> Any:
    return cantools.database.load_file(str(default_dbc_path()), database_format="dbc")


def _attribute(message: Any, name: str, absent: str = "-") -> str:
    attributes = message.dbc.attributes
    return str(attributes[name].value) if name in attributes else absent


def _sender(message: Any) -> str:
    return message.senders[0] if len(message.senders) == 1 else "any node"


def messages() -> str:
    """One line a message."""
    lines = [
        "| ID | Message | From | Bytes | Cycle ms | Time-out ms | E2E Data ID | MaxDelta |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for message in _database().messages:
        data_id = _attribute(message, "E2EDataId")
        lines.append(
            f"| 0x{message.frame_id:03X} | {message.name} | {_sender(message)} | {message.length} | "
            f"{message.cycle_time or 'event'} | {_attribute(message, 'RxTimeoutMs')} | "
            f"{data_id if data_id == '-' else f'0x{int(data_id):04X}'} | {_attribute(message, 'E2EMaxDeltaCounter')} |"
        )
    return "\n".join(lines) + "\n"


def layouts() -> str:
    """The payload of every message, signal by signal; counters of DIAG messages stand in a table of their own."""
    parts = []
    for message in _database().messages:
        if message.length == 0:
            continue
        lines = [
            f"**{message.name}** (0x{message.frame_id:03X})",
            "",
            "| Signal | Bits | Physical value | Start | |",
            "|---|---|---|---|---|",
        ]
        for signal in message.signals:
            if signal.name in ("CRC", "Counter"):
                continue
            if message.name.endswith("DIAG") and signal.multiplexer_ids is not None:
                continue
            lines.append(_layout_row(signal))
        if message.name.endswith("DIAG"):
            lines.append("| (counter of that index) | 32..63 | raw, 0..4294967295 | 0 | |")
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"


def _layout_row(signal: Any) -> str:
    scaled = "raw" if signal.scale == 1 else f"raw x {signal.scale:g}"
    scaled += f" {signal.offset:+g}" if signal.offset else ""
    attributes = signal.dbc.attributes
    start = attributes["GenSigStartValue"].value if "GenSigStartValue" in attributes else 0
    named = "Enumerated" in attributes and attributes["Enumerated"].value == 1
    cells = [
        signal.name,
        f"{signal.start}..{signal.start + signal.length - 1}{', signed' if signal.is_signed else ''}",
        f"{scaled}, {_number(signal.minimum)}..{_number(signal.maximum)} {signal.unit or ''}".rstrip(),
        str(int(start)),
        "; ".join(filter(None, ["value table" if named else "", signal.comment or ""])),
    ]
    return f"| {' | '.join(cells)} |"


def _number(value: float | None) -> str:
    """As a person writes it; cantools gives None for both ends of a range 0..0."""
    if value is None:
        return "0"
    return str(int(value)) if float(value).is_integer() else str(value)


def values() -> str:
    """Every value table, once."""
    tables: dict[str, str] = {}
    for message in _database().messages:
        for signal in message.signals:
            if signal.choices and not (message.name.endswith("DIAG") and signal.name == "Index"):
                text = ", ".join(f"{code} {name}" for code, name in sorted(signal.choices.items()))
                tables.setdefault(text, "")
                tables[text] += f"{', ' if tables[text] else ''}{message.name}.{signal.name}"
    return "\n".join(f"- {names}: {text}." for text, names in tables.items()) + "\n"


def counters() -> str:
    """What CTRL_DIAG counts; the first 21 are the device's reasons to refuse a frame."""
    database = _database()
    lines = ["| Index | CTRL_DIAG | Counts |", "|---|---|---|"]
    choices = _signal(database, "CTRL_DIAG", "Index").choices
    other = {
        "Trips": "watchdogs of the command path that expired where it mattered",
        "MacFailures": "wrong MACs since boot; the bridge waits for this one before it arms",
        "StallTicks": "ticks caught up after the computer stalled",
        "TxDropped": "own frames that could not be sent",
        "BusOffs": "bus-offs of the device's own controller",
        "EchoAgeMaxMs": "oldest echo accepted, ms",
        "LostFrames": "gaps in counters",
        "RejOwnId": "frames of the device's own identifiers from outside",
    }
    for index, name in sorted(choices.items()):
        meaning = _MEANING[Reject(index)] if index in list(Reject) else other[str(name)]
        lines.append(f"| {index} | {name} | {meaning} |")
    bridge = ", ".join(
        f"{index} {name}" for index, name in sorted(_signal(database, "BRIDGE_DIAG", "Index").choices.items())
    )
    clocks = (
        "ClockBoundUs and ClockResidualUs say, once a second, by how much stamps of the live device whose clock is\n"
        "least known may be off, and what its probes leave over, in us; 4294967295: not known just now. Without such a\n"
        "device they are not sent."
    )
    return (
        "\n".join(lines) + f"\n\nBRIDGE_DIAG has the same first twelve, seen from the bridge: {bridge}.\n\n{clocks}\n"
    )


def _signal(database: Any, message: str, name: str) -> Any:
    return database.get_message_by_name(message).get_signal_by_name(name)


def numbers() -> str:
    """The limits of both ends."""
    device = [
        ("no accepted ACT_CMD", f"{watchdogs.COMMAND_LIMIT_MS} ms", "disarm; RAMP_DOWN, then FOLLOW; a trip"),
        ("ACT_AUTH after its ACT_CMD", f"{watchdogs.AUTH_LIMIT_MS} ms", "the command counts as HOLD"),
        ("age of the echo", f"{watchdogs.ECHO_LIMIT_MS} ms", "the command counts as HOLD"),
        (
            "age of sensing",
            f"{watchdogs.SENSING_LIMIT_MS} ms",
            "ACT counts as HOLD; HOLD is a fault: RAMP_DOWN, then FOLLOW",
        ),
        ("no BRIDGE_HB while armed", f"{watchdogs.HEARTBEAT_LIMIT_MS} ms", "disarm; a trip"),
        ("gap between two 1 ms ticks of the device's own time", f"{watchdogs.TICK_LIMIT_MS} ms", "LATCHED"),
        ("one assist", f"{watchdogs.DWELL_LIMIT_MS} ms", "RAMP_DOWN, then FOLLOW: authorise anew"),
        ("ARM_RESPONSE after ARM_CHALLENGE", f"{watchdogs.CHALLENGE_LIMIT_MS} ms", "refused"),
        ("rest after a disturbed handshake failed", f"{watchdogs.DISTURBED_REST_MS} ms", "no request is answered"),
        ("local action after an authenticated ClearLatch", f"{watchdogs.CLEAR_LIMIT_MS} ms", "not cleared"),
        ("trips", f"{watchdogs.TRIP_LIMIT} in {watchdogs.TRIP_WINDOW_MS} ms", "LATCHED"),
        ("wrong MACs since boot or clearing", f"{watchdogs.MAC_FAILURE_LIMIT}", "LATCHED"),
        (
            "bus-offs",
            f"{watchdogs.BUS_OFF_LIMIT} in {watchdogs.BUS_OFF_WINDOW_MS} ms",
            "LATCHED (the first: disarm, FOLLOW)",
        ),
        ("HOLDs in a row before READY", f"{watchdogs.NEUTRAL_HOLDS}", "stays in FOLLOW"),
        ("self-test", f"{SELF_TEST_MS} ms", "then FOLLOW, or LATCHED where it failed"),
    ]
    bridge = [
        ("no accepted CTRL_STATUS", f"{limits.STATUS_LIMIT_NS // limits.MS} ms", "HOLD, session dropped"),
        ("own tick late by", f"{limits.TICK_NS // limits.MS} ms", "HOLD in that tick, counted"),
        ("age of sensing", f"{limits.SENSING_LIMIT_MS} ms", "HOLD"),
        (
            "a command in a full transmit queue",
            f"{limits.STALE_COMMAND_NS // limits.MS} ms",
            "never sent; session dropped",
        ),
        ("ARM_CHALLENGE after ARM_REQUEST", f"{limits.CHALLENGE_WAIT_NS // limits.MS} ms", "asks again, same nonce"),
        (
            "ARM_CHALLENGE after somebody else's ARM_REQUEST",
            f"{limits.STRANGER_NS // limits.MS} ms",
            "not answered; asks again",
        ),
        ("Armed = 1 after ARM_RESPONSE", f"{limits.CONFIRM_WAIT_NS // limits.MS} ms", "asks again"),
    ]
    lines = ["| End | What | Limit | Then |", "|---|---|---|---|"]
    lines += [f"| device | {what} | {limit} | {then} |" for what, limit, then in device]
    lines += [f"| bridge | {what} | {limit} | {then} |" for what, limit, then in bridge]
    return "\n".join(lines) + "\n"


def machine() -> str:
    """The parameters of the E2E state machine."""
    return (
        f"Window: {e2e.WINDOW} checks. NO_DATA -> INIT on the first good check.\n"
        f"INIT -> VALID with at least {e2e.MIN_OK_INIT} good checks and at most {e2e.MAX_ERROR_INIT} error in the window; "
        "with more errors INVALID.\n"
        f"VALID -> INVALID with more than {e2e.MAX_ERROR_VALID} error or fewer than {e2e.MIN_OK_VALID} good check.\n"
        f"INVALID -> VALID with at least {e2e.MIN_OK_INVALID} good checks and {e2e.MAX_ERROR_INVALID} errors.\n"
    )


def crc() -> str:
    """One HOLD, byte by byte."""
    payload = Codec().encode("ACT_CMD", {"Gate": "Hold", "Verb": "None", "SensingAge": 510})
    counter, data_id = 1, e2e.DATA_ID[frames.ACT_CMD]
    covered = bytes((counter,)) + payload[3:] + data_id.to_bytes(2, "little")
    sent = e2e.protect(frames.ACT_CMD, payload, counter)
    return _fixed(
        "ACT_CMD: Gate Hold (1), Verb None (0), Confidence 0, Session 0, Echo 0, SensingAge unknown (raw 255)",
        f"frame as one little-endian number  0x{int.from_bytes(payload, 'little'):016X}   (1 << 24 | 255 << 54)",
        f"payload, bytes 3..7                {payload[3:].hex(' ')}",
        f"counter, byte 2                    {counter:02x}",
        f"CRC over                           {covered.hex(' ')}   (bytes 2..7, Data ID 0x{data_id:04X})",
        f"CRC                                0x{e2e.crc16(covered):04X}",
        f"on the bus                         {sent.hex(' ')}",
        f"check value: CRC of the text 123456789 is 0x{e2e.crc16(b'123456789'):04X}",
    )


def _fixed(*lines: str) -> str:
    return "```\n" + "\n".join(lines) + "\n```\n"


def keys() -> str:
    """Arming and one ACT, with every byte that enters a MAC."""
    codec, crypto = Codec(), Authenticator(secoc.DEMO_KEY)
    key = secoc.session_key(secoc.DEMO_KEY, BRIDGE_NONCE, DEVICE_NONCE, BOOT_NONCE, SESSION)
    assert key == crypto.session_key(BRIDGE_NONCE, DEVICE_NONCE, BOOT_NONCE, SESSION)
    nonces = BRIDGE_NONCE.to_bytes(4, "big") + DEVICE_NONCE.to_bytes(4, "big")
    derived = b"\x01hilbridge session v1\x00" + nonces + BOOT_NONCE.to_bytes(4, "big") + bytes((SESSION,)) + b"\x00\x80"
    assert secoc.cmac(secoc.DEMO_KEY, derived) == key
    armed = frames.ARM_RESPONSE.to_bytes(2, "big") + bytes((frames.PURPOSE_ARM, SESSION)) + nonces
    arm_mac = secoc.arm_mac(key, frames.PURPOSE_ARM, SESSION, BRIDGE_NONCE, DEVICE_NONCE)
    assert arm_mac == crypto.arm_mac(key, "Arm", SESSION, BRIDGE_NONCE, DEVICE_NONCE) == secoc.truncated(key, armed)

    def framed(name: str, signals: dict[str, int | str], counter: int) -> bytes:
        return e2e.protect(codec.messages[name].can_id, codec.encode(name, signals), counter)

    act = framed(
        "ACT_CMD",
        {"Gate": "Act", "Verb": "Take", "Confidence": 93, "Session": SESSION, "Echo": 9, "SensingAge": 40},
        5,
    )
    authorised = frames.ACT_CMD.to_bytes(2, "big") + bytes((SESSION,)) + (1).to_bytes(4, "big") + act
    mac = secoc.act_mac(key, SESSION, 1, act)
    assert mac == crypto.act_mac(key, SESSION, 1, act) == secoc.truncated(key, authorised)
    heartbeat = framed("CTRL_HB", {"ProtocolVersion": 1, "BootNonce": BOOT_NONCE}, 1)
    request = framed("ARM_REQUEST", {"BridgeNonce": BRIDGE_NONCE, "Purpose": "Arm"}, 1)
    challenge = framed("ARM_CHALLENGE", {"DeviceNonce": DEVICE_NONCE, "Session": SESSION}, 1)
    response = framed("ARM_RESPONSE", {"Mac": arm_mac, "Session": SESSION}, 1)
    proof = framed("ACT_AUTH", {"Freshness": 1, "Mac": mac}, 1)
    return _fixed(
        f"shared key             {secoc.DEMO_KEY.hex()}   (the demo key)",
        f"CTRL_HB                {heartbeat.hex(' ')}   boot nonce 0x{BOOT_NONCE:08X}",
        f"ARM_REQUEST            {request.hex(' ')}   bridge nonce 0x{BRIDGE_NONCE:08X}",
        f"ARM_CHALLENGE          {challenge.hex(' ')}   device nonce 0x{DEVICE_NONCE:08X}, session {SESSION}",
        f"session key from       {derived.hex()}",
        f"session key            {key.hex()}",
        f"MAC of response over   {armed.hex()}",
        f"MAC                    0x{arm_mac:08X}",
        f"ARM_RESPONSE           {response.hex(' ')}",
        "",
        f"ACT_CMD                {act.hex(' ')}   Act, Take, 93 %, session {SESSION}, echo 9, age 40 ms; counter 5",
        f"MAC of ACT over        {authorised.hex()}   freshness 1",
        f"MAC                    0x{mac:08X}",
        f"ACT_AUTH               {proof.hex(' ')}",
    )


def states() -> str:
    """States and reasons by number, events by name."""
    return (
        f"States: {', '.join(f'{state.value} {state.name}' for state in State)}. "
        f"Events: {', '.join(event.name for event in Event)}. Reasons: {len(Reason)}, in the value tables above.\n"
    )


def cycles() -> str:
    """How often the device sends."""
    return (
        f"CTRL_STATUS {transmit.STATUS_CYCLE_MS} ms and at once on a change of state, CTRL_MEAS {transmit.MEAS_CYCLE_MS} ms, "
        f"CTRL_HB {transmit.HEARTBEAT_CYCLE_MS} ms, CTRL_DIAG {transmit.DIAG_CYCLE_MS} ms.\n"
    )


BLOCKS: dict[str, Callable[[], str]] = {
    made.__name__: made for made in (messages, layouts, values, counters, numbers, machine, crc, keys, states, cycles)
}


def written(page: str) -> str:
    """The page with every block as the code has it now."""
    return _BLOCK.sub(lambda match: match[1] + BLOCKS[match[2]]() + match[3], page)


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
