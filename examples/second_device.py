"""A second device for the bridge, written from docs/protocol.md and the DBC alone (python-can, cantools, cryptography).

`python examples/second_device.py hilsim:bench` and, beside it, `hilbridge run --bus hilsim:bench ...`. It follows, arms,
acts, holds and stops as the contract says; its assist is a number. A real device adds motor, sensors and clearing of latches.
"""

import secrets
import sys
import time
from binascii import crc_hqx
from contextlib import suppress
from dataclasses import dataclass, field

import can
import cantools.database
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.cmac import CMAC

DEMO_KEY = bytes.fromhex("68696c6272696467652d64656d6f2d6b")
DATA_ID = {n: 0x1000 + n for n in (0x20, 0x60, 0x61, 0xA0, 0xA1, 0x120, 0x121, 0x180, 0x181, 0x182, 0x300, 0x301)}
MAX_DELTA = {0x060: 3, 0x061: 255, 0x120: 3, 0x180: 255, 0x182: 255, 0x300: 255}  # what the bridge sends
STOP, ACT_CMD, ACT_AUTH, STATUS, MEAS = 0x001, 0x060, 0x061, 0x0A0, 0x0A1
BRIDGE_HB, CTRL_HB, REQUEST, CHALLENGE, RESPONSE, DIAG = 0x120, 0x121, 0x180, 0x181, 0x182, 0x301
OWN = {0x020, STATUS, MEAS, CTRL_HB, CHALLENGE, DIAG}
FOLLOW, READY, ASSIST, RAMP_DOWN, LATCHED, ESTOP = 2, 3, 4, 5, 7, 8
NONE, HOLD, VERB_CHANGE, COMMAND_TIMEOUT, E2E_INVALID, AUTH_MISSING, HEARTBEAT_TIMEOUT, DWELL = 0, 1, 2, 3, 4, 5, 8, 9
STOP_RECEIVED, TRIPS, MACS, OWN_ID, NEUTRAL, AUTHORISED = 14, 19, 20, 22, 26, 27
NEVER_ASSISTED, RAMP_MS = {0, 5, 31}, 40


def crc16(can_id: int, data: bytes) -> bytes:
    """The CRC-16/CCITT-FALSE of a frame's bytes 2..7 and its Data ID, as sent."""
    return crc_hqx(data + DATA_ID[can_id].to_bytes(2, "little"), 0xFFFF).to_bytes(2, "little")


def mac(key: bytes, data: bytes) -> bytes:
    """AES-128-CMAC, all 16 bytes."""
    made = CMAC(AES(key))
    made.update(data)
    return made.finalize()


class Wire:
    """Frames to and from signals, by the DBC's layout: raw numbers, strictly checked."""

    def __init__(self, dbc: str) -> None:
        self.messages = {message.frame_id: message for message in cantools.database.load_file(dbc).messages}

    def encode(self, can_id: int, counter: int, **signals: int) -> bytes:
        """A protected frame of raw signal values; those not named have their start value."""
        word = counter << 16
        for signal in self._present(can_id, signals.get("Index", signals.get("Joint"))):
            word |= (signals.get(signal.name, signal.raw_initial or 0) & (1 << signal.length) - 1) << signal.start
        data = word.to_bytes(8, "little")[2:]
        return crc16(can_id, data) + data

    def _present(self, can_id: int, index: int | None) -> list[cantools.database.Signal]:
        chosen = [signal for signal in self.messages[can_id].signals if signal.name not in ("CRC", "Counter")]
        return [s for s in chosen if s.multiplexer_ids is None or index in s.multiplexer_ids]

    def read(self, can_id: int, data: bytes) -> dict[str, int] | str:
        """Raw signals, or the counter of CTRL_DIAG that the frame adds to."""
        word = int.from_bytes(data, "little")
        present = self._present(can_id, word >> 24 & 0xFF if can_id == 0x300 else None)
        used = sum(((1 << signal.length) - 1) << signal.start for signal in present)
        if can_id == 0x300 and len(present) == 1:
            return "RejMux"
        if word >> 24 << 24 & ~used:
            return "RejReserved"
        found = {signal.name: word >> signal.start & (1 << signal.length) - 1 for signal in present}
        for signal in sorted(present, key=lambda signal: signal.start):
            raw, scale, offset = found[signal.name], signal.conversion.scale, signal.conversion.offset
            names = signal.choices or {}
            if len(names) > 1 and raw not in names:
                return "RejEnum"
            if raw not in names and not signal.minimum <= raw * scale + offset <= signal.maximum:
                return "RejRange"
        return found


@dataclass
class Machine:
    """The E2E receiver of one message: NoData, Init, Valid, Invalid over a window of four checks."""

    max_delta: int
    last: int | None = None
    state: str = "no data"
    window: list[bool | None] = field(default_factory=list)  # True good, False error, None neither

    def check(self, counter: int) -> str | None:
        """Take a frame with a right CRC; the counter that it adds to, or None where it is good."""
        delta = 1 if self.last is None else (counter - self.last) & 0xFF
        if delta == 0:
            self._note(None)
            return "RejRepeated"
        self.last = counter
        self._note(delta <= self.max_delta)
        return None if delta <= self.max_delta else "RejSequence"

    def _note(self, good: bool | None) -> None:
        self.window = [*self.window, good][-4:]
        rights, errors = self.window.count(True), self.window.count(False)
        match self.state:
            case "no data":
                self.state = "init" if rights else "no data"
            case "init":
                self.state = "invalid" if errors > 1 else "valid" if rights >= 2 else "init"
            case "valid":
                self.state = "invalid" if errors > 1 or rights < 1 else "valid"
            case "invalid":
                self.state = "valid" if rights >= 2 and not errors else "invalid"


class Device:
    """The protocol. `receive` for each frame, `tick` once a millisecond; both give frames to send."""

    def __init__(self, dbc: str, key: bytes = DEMO_KEY) -> None:
        self.wire, self.key = Wire(dbc), key
        self.state, self.reason, self.verb, self.assist, self.trips = FOLLOW, NONE, 0, 0.0, []
        self.boot_nonce = secrets.randbits(32)
        self.machines = {can_id: Machine(delta) for can_id, delta in MAX_DELTA.items()}
        index = self.wire.messages[DIAG].get_signal_by_name("Index")
        self.counters = {str(name): 0 for _, name in sorted(index.choices.items())}
        self.sent, self.echoes = dict.fromkeys(OWN, 0), {}  # echoes: counter of a CTRL_STATUS -> when it was sent
        self.session = self.last_session = self.freshness = self.neutral = self.accepted = self.diag = 0
        self.session_key, self.challenge, self.pending, self.command_ms = b"", None, None, None
        self.now_ms = self.heartbeat_ms = self.ramp_from_ms = self.assist_from_ms = self.fault = self.status_now = 0

    def _send(self, can_id: int, **signals: int) -> tuple[int, bytes]:
        self.sent[can_id] = (self.sent[can_id] + 1) & 0xFF
        return can_id, self.wire.encode(can_id, self.sent[can_id], **signals)

    def _go(self, state: int, reason: int) -> None:
        if (state, reason) != (self.state, self.reason):
            self.state, self.reason, self.status_now = state, reason, True

    def _disarm(self) -> None:
        self.session, self.session_key, self.pending, self.neutral, self.command_ms = 0, b"", None, 0, None

    def _end_assist(self, reason: int, fault: bool) -> None:
        if self.state == ASSIST:
            self.fault, self.ramp_from_ms = fault, self.now_ms
            self._go(RAMP_DOWN, reason)
        elif fault and self.state == RAMP_DOWN:
            self.fault = True
        elif fault and self.state == READY:
            self._go(FOLLOW, reason)

    def _trip(self, reason: int) -> None:
        if self.state in (READY, ASSIST) or (self.state == RAMP_DOWN and not self.fault):
            self.counters["Trips"] += 1
            self.trips = [at for at in self.trips if self.now_ms - at < 60_000] + [self.now_ms]
        self._end_assist(reason, fault=True)
        if len(self.trips) >= 3:
            self._latch(TRIPS)

    def _latch(self, reason: int, state: int = LATCHED) -> None:
        self._disarm()
        self._go(state, reason)

    def receive(self, frame: can.Message) -> list[tuple[int, bytes]]:
        """One frame from the bus. STOP stops in any form."""
        can_id, data = frame.arbitration_id, bytes(frame.data)
        if can_id == STOP:
            self._latch(STOP_RECEIVED, ESTOP)
            return []
        why, signals = self.judge(frame)
        self.counters[why] += 1
        if why == "RejOwnId":
            self._latch(OWN_ID)
        if signals is None:
            if can_id == ACT_CMD and self.machines[ACT_CMD].state == "invalid":
                self._trip(E2E_INVALID)
            return []
        if can_id == BRIDGE_HB:
            self.heartbeat_ms = self.now_ms
        act = {ACT_CMD: self._command, ACT_AUTH: self._authorise, REQUEST: self._challenge, RESPONSE: self._arm}
        return act[can_id](signals, data) or [] if can_id in act else []

    def judge(self, frame: can.Message) -> tuple[str, dict[str, int] | None]:
        """The counter of CTRL_DIAG that a frame adds to, and its signals where it is taken in."""
        can_id, data = frame.arbitration_id, bytes(frame.data)
        if frame.is_error_frame or frame.is_extended_id or frame.is_remote_frame or frame.is_fd:
            return "RejKind", None
        if can_id not in MAX_DELTA:
            return ("RejOwnId" if can_id in OWN else "RejUnknownId"), None
        if len(data) != 8:
            return "RejLength", None
        machine = self.machines[can_id]
        if crc16(can_id, data[2:]) != data[:2]:
            machine._note(False)
            return "RejCrc", None
        if (why := machine.check(data[2])) is not None:
            return why, None
        signals = self.wire.read(can_id, data)
        if isinstance(signals, str):
            return signals, None
        return ("RxAccepted", signals) if signals.get("ProtocolVersion", 1) == 1 else ("RejRange", None)

    def _command(self, s: dict[str, int], data: bytes) -> None:
        if self.pending is not None:  # overtaken
            self._refuse("RejAuthMissing", AUTH_MISSING)
        echo_ms = self.echoes.get(s["Echo"])
        fresh = echo_ms is not None and self.now_ms - echo_ms <= 100
        sensed, valid = s["SensingAge"] <= 75, self.machines[ACT_CMD].state == "valid"
        if s["Gate"] == 1:
            ours = valid and self.session and s["Session"] == self.session and fresh and sensed
            self.neutral = self.neutral + 1 if ours else 0
            self.command_ms, self.accepted = self.now_ms, data[2]
            self._end_assist(HOLD, fault=not sensed)
            if self.state == FOLLOW and self.neutral >= 3:
                self._go(READY, NEUTRAL)
            return
        self.neutral = 0
        asked = {"RejE2EState": valid, "RejNotArmed": self.session, "RejSession": s["Session"] == self.session}
        asked |= {"RejEcho": fresh, "RejAge": sensed, "RejVerb": s["Verb"] not in NEVER_ASSISTED}
        if (why := next((name for name, holds in asked.items() if not holds), None)) is not None:
            self._refuse(why, HOLD)
        else:
            self.pending = (self.now_ms, data, s["Verb"])

    def _refuse(self, why: str, reason: int) -> None:
        """An ACT that counts as HOLD: it is counted, and feeds no deadline."""
        self.counters[why] += 1
        self.pending = None
        self._end_assist(reason, fault=False)

    def _authorise(self, s: dict[str, int], _: bytes) -> None:
        if self.pending is None:
            self.counters["RejAuthUnpaired"] += 1
            return
        command, verb = self.pending[1:]
        freshness = self.freshness + ((s["Freshness"] - self.freshness - 1) & 0xFF) + 1
        text = ACT_CMD.to_bytes(2, "big") + bytes([self.session]) + freshness.to_bytes(4, "big") + command
        if int.from_bytes(mac(self.session_key, text)[:4], "big") != s["Mac"]:
            self._refuse("RejMac", HOLD)
            self._wrong_mac()
            return
        self.freshness, self.pending = freshness, None
        self.command_ms, self.accepted = self.now_ms, command[2]
        if self.state == READY:
            self.verb, self.assist_from_ms = verb, self.now_ms
            self._go(ASSIST, AUTHORISED)
        elif self.state == ASSIST and verb != self.verb:
            self._end_assist(VERB_CHANGE, fault=False)

    def _wrong_mac(self) -> None:
        self.counters["MacFailures"] += 1
        if self.counters["MacFailures"] >= 3:
            self._latch(MACS)

    def _challenge(self, s: dict[str, int], _: bytes) -> list[tuple[int, bytes]]:
        if s["Purpose"] != 1 or self.state not in (FOLLOW, READY):
            self.counters["RejHandshake"] += 1
            return []
        session = self.last_session = self.last_session % 255 + 1
        nonce = secrets.randbits(32)
        self.challenge = (self.now_ms, s["BridgeNonce"], nonce, session)
        return [self._send(CHALLENGE, DeviceNonce=nonce, Session=session)]

    def _arm(self, s: dict[str, int], _: bytes) -> None:
        challenge, self.challenge = self.challenge, None
        if challenge is None or self.now_ms - challenge[0] > 500 or s["Session"] != challenge[3]:
            self.counters["RejHandshake"] += 1
            return
        theirs, ours, session = challenge[1:]
        nonces = theirs.to_bytes(4, "big") + ours.to_bytes(4, "big")
        label = b"\x01hilbridge session v1\x00"
        key = mac(self.key, label + nonces + self.boot_nonce.to_bytes(4, "big") + bytes([session, 0, 0x80]))
        if int.from_bytes(mac(key, b"\x01\x82\x01" + bytes([session]) + nonces)[:4], "big") != s["Mac"]:
            self.counters["RejMac"] += 1
            self._wrong_mac()
            return
        self.session, self.session_key, self.freshness, self.neutral = session, key, 0, 0
        self.heartbeat_ms, self.pending, self.status_now = self.now_ms, None, True
        self._go(FOLLOW, NONE)

    def tick(self, now_ms: int) -> list[tuple[int, bytes]]:
        """Deadlines, the ramp, and what is due to be sent."""
        self.now_ms = now_ms
        if self.pending is not None and now_ms - self.pending[0] >= 10:
            self._refuse("RejAuthMissing", AUTH_MISSING)
        if self.command_ms is not None and now_ms - self.command_ms >= 100:
            self._trip(COMMAND_TIMEOUT)
            self._disarm()
            self.machines[ACT_CMD].state, self.machines[ACT_CMD].window = "invalid", []
        if self.session and now_ms - self.heartbeat_ms >= 250:
            self._trip(HEARTBEAT_TIMEOUT)
            self._disarm()
        if self.state == ASSIST and now_ms - self.assist_from_ms >= 10_000:
            self._end_assist(DWELL, fault=True)
            self._disarm()
        ramp = {ASSIST: 0.01, RAMP_DOWN: -1.0 / RAMP_MS, ESTOP: -0.1}.get(self.state, -1.0 / RAMP_MS)
        self.assist = min(1.0, max(0.0, self.assist + ramp))
        if self.state == RAMP_DOWN and now_ms - self.ramp_from_ms >= RAMP_MS:
            self.assist = 0.0
            self._go(FOLLOW if self.fault else READY, self.reason)
        return self._due(now_ms)

    def _due(self, now_ms: int) -> list[tuple[int, bytes]]:
        frames = []
        if self.status_now or now_ms % 20 == 0:
            self.status_now, acts = False, self.state == ASSIST
            status = {
                "State": self.state,
                "Reason": self.reason,
                "AcceptedCounter": self.accepted,
                "Session": self.session,
            }
            status |= {"AppliedVerb": self.verb if acts else 0, "Authority": 100 if acts else 0}
            frames.append(
                self._send(STATUS, **status, Armed=int(bool(self.session)), AssistZero=int(self.assist == 0.0))
            )
            self.echoes[self.sent[STATUS]] = now_ms
        if now_ms % 20 == 10:
            frames.append(self._send(MEAS, Joint=0, Angle=300, AssistTorque=round(self.assist / 0.02)))
        if now_ms % 100 == 5:
            frames.append(self._send(CTRL_HB, ProtocolVersion=1, BootNonce=self.boot_nonce))
        if now_ms % 34 == 15:
            names = list(self.counters)
            self.diag = (self.diag + 1) % len(names)
            name = names[self.diag]
            frames.append(self._send(DIAG, Index=self.diag, **{name: min(self.counters[name], 0xFFFFFFFF)}))
        return frames


def main(bus_name: str, dbc: str = "dbc/iassistadl.dbc", seconds: str = "1e9") -> None:
    """Run on a bus in real time: one tick a millisecond, those that a slow computer missed one after the other."""
    interface, _, channel = bus_name.partition(":") if ":" in bus_name else ("socketcan", ":", bus_name)
    device, start = Device(dbc), time.monotonic()
    with can.Bus(interface=interface, channel=channel) as bus:
        for tick in range(1, int(float(seconds) * 1000)):
            answers = []
            while (frame := bus.recv(timeout=max(0.0, start + tick / 1000 - time.monotonic()))) is not None:
                answers += device.receive(frame)
            for can_id, data in answers + device.tick(tick):
                with suppress(can.CanError):  # alone on the bus, where nobody acknowledges
                    bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))


if __name__ == "__main__":
    main(*sys.argv[1:])
