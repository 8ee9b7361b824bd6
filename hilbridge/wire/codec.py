"""Signals <-> bytes, from the DBC. cantools reads the file once; the tables made of it do the work at run time.

A frame from the bus is checked for exact length, reserved bits, multiplexer, value table and range; what fails any of
it is a `Rejected` with a reason, never an exception. Enumerated signals (own attribute of the DBC) travel under their
names from the value table, so that a site may renumber them; all others are physical values, int where scale and
offset are.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

from hilbridge.records import Frame
from hilbridge.wire.dbc import REQUIRED, Message, Value, default_dbc_path, read_message, required_message
from hilbridge.wire.dbc_file import DbcError, dbc_number, load_dbc, same_identifier, shown_number


class RejectReason(StrEnum):
    """Why a received frame was dropped; the value is the counter's name in BRIDGE_DIAG."""

    LENGTH = "RejLength"
    RANGE = "RejRange"
    MUX = "RejMux"
    ENUM = "RejEnum"
    RESERVED = "RejReserved"
    UNKNOWN_ID = "RejUnknownId"
    KIND = "RejKind"
    CRC = "RejCrc"
    REPEATED = "RejRepeated"
    SEQUENCE = "RejSequence"
    E2E_STATE = "RejE2EState"


class Decoded(NamedTuple):
    """A frame understood: message name, its signals by name (CRC and counter apart), the E2E counter, the frame."""

    name: str
    signals: Mapping[str, Value]
    counter: int
    frame: Frame


class Rejected(NamedTuple):
    """A frame dropped, and why; `name` is the message where the identifier is known, else empty."""

    reason: RejectReason
    name: str
    frame: Frame


class Codec:
    """The DBC as tables. `messages` by name; `by_id` by the DBC's number (an extended identifier has bit 31 set).

    What others send need not be of a kind that this codec speaks: `left_out` has those messages' names and why.
    """

    def __init__(self, dbc_path: Path | None = None) -> None:
        """Read a DBC (the shipped one by default). Raises DbcError in one line naming file, message and cure."""
        self.path = dbc_path or default_dbc_path()
        read = list(load_dbc(self.path).messages)
        self._check_identifiers(read)
        self.messages: dict[str, Message] = {}
        self.left_out: dict[str, str] = {}
        for message in read:
            if message.name in REQUIRED:
                self.messages[message.name] = required_message(message, self.path)
                continue
            try:
                layout = read_message(message, self.path)
            except Exception as error:  # another's message; whatever ails it is not this bridge's
                self.left_out[message.name] = str(error) or type(error).__name__
            else:
                self.messages.setdefault(message.name, layout)
        self.by_id = {
            dbc_number(message.can_id, is_extended=message.is_extended): message
            for message in self.messages.values()
            if not message.is_fd
        }
        self._check_required()

    @property
    def verbs(self) -> frozenset[str]:
        """Names of the value table of ACT_CMD.Verb: what the bus can say."""
        verb = next((one for one in self.messages["ACT_CMD"].signals if one.name == "Verb"), None)
        return frozenset(verb.codes or ()) if verb is not None else frozenset()

    def _check_identifiers(self, read: list[Any]) -> None:
        for number, names in same_identifier(read).items():
            if not REQUIRED.keys().isdisjoint(names):
                raise DbcError(
                    f"{self.path}: messages {' and '.join(names)} have one identifier {shown_number(number)}; "
                    "give each its own, or take one out"
                )
        for name, count in Counter(message.name for message in read).items():
            if count > 1 and name in REQUIRED:
                raise DbcError(f"{self.path}: message {name} is there {count} times; take all but one out")

    def _check_required(self) -> None:
        cure = f"restore it from {default_dbc_path().name} as shipped"
        for name, signals in REQUIRED.items():
            if name not in self.messages:
                raise DbcError(f"{self.path}: message {name} is missing; {cure}")
            message = self.messages[name]
            have = {s.name for s in message.signals}.union(s.name for g in message.groups.values() for s in g)
            for signal in signals:
                if signal not in have:
                    raise DbcError(f"{self.path}: message {name} lacks signal {signal}; {cure}")
            if name != "STOP" and message.data_id is None:
                raise DbcError(f"{self.path}: message {name} lacks the attribute E2EDataId; {cure}")
        self._stop_id = self.messages["STOP"].can_id

    def encode(self, message: str, signals: Mapping[str, Value]) -> bytes:
        """Bytes with CRC and counter zero. Signals left out take their start value.

        Raises KeyError for an unknown message, ValueError for a signal it lacks or a value the DBC does not allow.
        """
        layout = self.messages[message]
        word = 0
        fields = layout.signals
        if layout.multiplexer is not None:
            selector = layout.multiplexer
            value = selector.to_raw(signals[selector.name]) if selector.name in signals else selector.start_value
            fields = fields + layout.groups.get(value, ())
        taken = 0
        for field in fields:
            if field.name in signals:
                raw = field.to_raw(signals[field.name])
                taken += 1
            else:
                raw = field.start_value
            word |= (raw & ((1 << field.bits) - 1)) << field.start
        if taken != len(signals):
            unknown = sorted(set(signals) - {field.name for field in fields})
            raise ValueError(f"{message} has no signal {', '.join(unknown)}")
        return word.to_bytes(layout.length, "little")

    def decode(self, frame: Frame) -> Decoded | Rejected:
        """What a frame says, without regard to CRC and sequence (hilbridge.wire.e2e). Never raises."""
        if (
            frame.can_id == self._stop_id and not frame.is_error
        ):  # a stop in any form: remote, FD, extended, of any length
            return Decoded("STOP", {}, 0, frame)
        if frame.is_error or frame.is_fd or frame.is_extended or frame.is_remote:
            return Rejected(RejectReason.KIND, "", frame)
        layout = self.by_id.get(frame.can_id)
        if layout is None:
            return Rejected(RejectReason.UNKNOWN_ID, "", frame)
        if len(frame.data) != layout.length:
            return Rejected(RejectReason.LENGTH, layout.name, frame)
        return self.read(layout, frame)

    def read(self, layout: Message, frame: Frame) -> Decoded | Rejected:
        """What a plain frame of that message and of its length says. Never raises."""
        word = int.from_bytes(frame.data, "little")
        group = None if layout.multiplexer is None else layout.multiplexer.raw(word)
        content = layout.contents.get(group)
        if content is None:
            return Rejected(RejectReason.MUX, layout.name, frame)
        if word & content.reserved_bits:
            return Rejected(RejectReason.RESERVED, layout.name, frame)
        signals: dict[str, Value] = {}
        for name, start, mask, sign, names, lowest, highest, scale, offset in content.readings:
            raw = word >> start & mask
            if raw & sign:
                raw -= mask + 1
            if names is not None:
                named = names.get(raw)
                if named is None:
                    return Rejected(RejectReason.ENUM, layout.name, frame)
                signals[name] = named
            elif lowest <= raw <= highest:
                signals[name] = raw * scale + offset
            else:
                return Rejected(RejectReason.RANGE, layout.name, frame)
        counter = (word >> 16) & 0xFF if layout.data_id is not None else 0
        return Decoded(layout.name, signals, counter, frame)
