"""Frames in words: the signals of every message of a DBC, as rows of a topic of their own."""

from __future__ import annotations

from typing import Any

from hilbridge.records import Frame
from hilbridge.rows import SIGNAL_TOPICS, CanRow, Direction, Row, SignalRow
from hilbridge.wire.codec import Codec, Decoded
from hilbridge.wire.dbc import Message, Signal, Value

_WENT_OUT = (None, "sent", "queued")
_DIRECTION = {"type": "string", "enum": [str(direction) for direction in Direction]}
TEXT = "_text"


class SignalRows:
    """What a recording adds to /can: accepted frames, and those that were sent, decoded."""

    def __init__(self, codec: Codec) -> None:
        self._codec = codec
        self._codes = {message.name: _codes(message) for message in codec.messages.values()}
        self.schemas = {SIGNAL_TOPICS + message.name: _schema(message) for message in codec.messages.values()}

    def of(self, row: Row) -> Row | None:
        """The frame of a row in words; None for other rows, and for what was rejected or never went out."""
        if not isinstance(row, CanRow):
            return None
        if row.name is None if row.direction is Direction.RX else row.result not in _WENT_OUT:
            return None
        frame = Frame(row.can_id, row.data, 0, 0, row.is_error, row.is_fd, row.is_extended, 0, row.is_remote)
        decoded = self._codec.decode(frame)
        if not isinstance(decoded, Decoded):
            return None
        return SignalRow(row.time_ns, decoded.name, row.direction, self._values(decoded))

    def _values(self, decoded: Decoded) -> dict[str, Value]:
        codes, values = self._codes[decoded.name], dict[str, Value]()
        for name, value in decoded.signals.items():
            if isinstance(value, str):
                values[name] = codes[name][value]
                values[name + TEXT] = value
            else:
                values[name] = value
        if self._codec.messages[decoded.name].data_id is not None:
            values["Counter"] = decoded.counter
        return values


def _signals(message: Message) -> list[Signal]:
    """Every signal once, also those of some multiplexer values only."""
    found = {signal.name: signal for signal in message.signals}
    if message.multiplexer is not None:
        found[message.multiplexer.name] = message.multiplexer
    for group in message.groups.values():
        found |= {signal.name: signal for signal in group}
    return list(found.values())


def _codes(message: Message) -> dict[str, dict[str, int]]:
    """Word -> number of each signal that travels under names."""
    return {
        signal.name: {word: code for code, word in signal.names.items()}
        for signal in _signals(message)
        if signal.names is not None
    }


def _schema(message: Message) -> dict[str, Any]:
    properties: dict[str, Any] = {"direction": _DIRECTION}
    for signal in _signals(message):
        properties[signal.name] = {"type": "number"}
        if signal.names is not None:
            properties[signal.name + TEXT] = {"type": "string"}
    if message.data_id is not None:
        properties["Counter"] = {"type": "number"}
    return {"type": "object", "properties": properties, "required": ["direction"]}
