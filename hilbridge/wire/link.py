"""The bridge's end of the contract: codec and E2E together, the state of every message and a count of every drop."""

from __future__ import annotations

from collections.abc import Mapping

from hilbridge.records import Frame
from hilbridge.wire.codec import Codec, Decoded, Rejected, RejectReason
from hilbridge.wire.dbc import Message, Value
from hilbridge.wire.e2e import CheckStatus, MachineState, ReceiverState, check, protect

_REJECTS = {
    CheckStatus.ERROR: RejectReason.CRC,
    CheckStatus.REPEATED: RejectReason.REPEATED,
    CheckStatus.WRONG_SEQUENCE: RejectReason.SEQUENCE,
}
_FRESH = ReceiverState()
_INVALID = MachineState.INVALID


class WireLink:
    """Encodes what `node` sends and takes in what others send. Deterministic; reads no clock."""

    def __init__(self, codec: Codec, node: str = "BRIDGE") -> None:
        """`node` is the DBC's name of this side: its own messages are not accepted from the bus."""
        self.codec = codec
        self.node = node
        self.counters: dict[str, int] = {
            "RxAccepted": 0,
            **{reason.value: 0 for reason in RejectReason},
            "LostFrames": 0,
        }
        self._sent: dict[str, int] = {}
        self._received: dict[str, ReceiverState] = {}

    def encode(self, message: str, signals: Mapping[str, Value]) -> Frame:
        """The next protected frame of a message; its counter moves on. Raises as Codec.encode."""
        data = self.codec.encode(message, signals)
        layout = self.codec.messages[message]
        if layout.data_id is None:
            return Frame(layout.can_id, data, is_fd=layout.is_fd, is_extended=layout.is_extended)
        counter = (self._sent.get(message, 0) + 1) & 0xFF
        self._sent[message] = counter
        protected = protect(data, layout.data_id, counter)
        return Frame(layout.can_id, protected, is_fd=layout.is_fd, is_extended=layout.is_extended)

    def decode(self, frame: Frame) -> Decoded | Rejected:
        """Length, CRC, sequence, state machine, then content. Never raises; every outcome is counted."""
        outcome = self._decode(frame)
        key = "RxAccepted" if isinstance(outcome, Decoded) else outcome.reason.value
        self.counters[key] += 1
        return outcome

    def _decode(self, frame: Frame) -> Decoded | Rejected:
        layout = self.codec.by_id.get(frame.can_id)
        plain = not (frame.is_error or frame.is_fd or frame.is_extended or frame.is_remote)
        if plain and layout is not None and layout.data_id is not None:
            if self.node in layout.senders:
                return Rejected(RejectReason.UNKNOWN_ID, layout.name, frame)
            if len(frame.data) != layout.length:
                return Rejected(RejectReason.LENGTH, layout.name, frame)
            reason = self._checked(layout, frame.data, layout.data_id)
            if reason is not None:
                return Rejected(reason, layout.name, frame)
            return self.codec.read(layout, frame)
        return self.codec.decode(frame)

    def _checked(self, layout: Message, data: bytes, data_id: int) -> RejectReason | None:
        before = self._received.get(layout.name, _FRESH)
        status, after = check(data, data_id, layout.max_delta, before)
        self._received[layout.name] = after
        self.counters["LostFrames"] += after.lost - before.lost
        if status in _REJECTS:
            return _REJECTS[status]
        return RejectReason.E2E_STATE if after.machine is _INVALID else None

    def machine(self, message: str) -> MachineState:
        """State of a received message's E2E machine."""
        return self._received.get(message, _FRESH).machine
