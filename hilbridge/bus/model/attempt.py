"""One attempt to send, bit by bit and node by node: what an error or a collision does to everybody (ISO 11898-1, 12.1).

Only attempts that are disturbed come here. Each node drives a bit, the wire is dominant where any of them is, each node
looks at the wire (or at a flipped bit) and reacts. Error flags, their superposition, passive flags and the first flag
to end all follow from that; nothing here knows in advance how a disturbance ends.

A receiver's view is simplified at one point: a wrong bit that the stuff rule does not reveal is found by the CRC (no
acknowledgement, an error flag after the ACK delimiter), never earlier by a shifted field.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from hilbridge.bus.model.bits import ERROR_DELIMITER_BITS, ERROR_FLAG_BITS, EncodedFrame
from hilbridge.bus.model.error_frames import ErrorKind

_BIT_LIMIT_AFTER_FRAME = 200  # flags and delimiters end long before


class Party(NamedTuple):
    """One node of an attempt: `frame` is what it sends, None for a receiver."""

    frame: EncodedFrame | None
    passive: bool
    acknowledges: bool = True
    listen_only: bool = False


@dataclass(slots=True)
class PartyResult:
    """What became of a node: frame through (sent or accepted), its first error, and what its counters make of it.

    `counts_transmit` and `counts_receive` say how often rules c and a apply, `dominant_after_flag` whether rule b does.
    """

    done: bool = False
    error: ErrorKind | None = None
    counts_transmit: int = 0
    counts_receive: int = 0
    dominant_after_flag: bool = False
    unacknowledged: bool = False


class AttemptOutcome(NamedTuple):
    """Results per node, the bit where the first error was seen (None: undisturbed), and bits until intermission."""

    parties: dict[int, PartyResult]
    detected_bit: int | None
    end_bit: int


class _Mode(StrEnum):
    FRAME = "frame"
    FLAG = "flag"
    WAIT = "wait"
    DELIMITER = "delimiter"
    REST = "rest"


@dataclass(slots=True)
class _Node:
    party: Party
    sending: bool
    result: PartyResult = field(default_factory=PartyResult)
    mode: _Mode = _Mode.FRAME
    run: int = 0
    last: int = -1
    left: int = 0
    wrong: bool = False
    first_wait: bool = False

    def drives(self, index: int, reference: EncodedFrame) -> int:
        if self.party.listen_only:
            return 1
        if self.mode is _Mode.FRAME:
            if self.sending:
                assert self.party.frame is not None
                bits = self.party.frame.bits
                return bits[index] if index < len(bits) else 1
            acking = index == reference.ack_slot and self.party.acknowledges and not self.wrong
            return 0 if acking else 1
        return 0 if self.mode is _Mode.FLAG and not self.party.passive else 1

    def raise_flag(self, kind: ErrorKind | None, *, counts: bool = True) -> None:
        """Begin an error flag at the next bit (an overload flag where `kind` is None)."""
        if kind is not None:
            self.result.error = self.result.error or kind
            if counts and self.sending:
                self.result.counts_transmit += 1
                self.result.unacknowledged = kind is ErrorKind.ACK
            elif counts:
                self.result.counts_receive += 1
        self.mode, self.left, self.run, self.last = _Mode.FLAG, ERROR_FLAG_BITS, 0, -1

    def observe(self, index: int, driven: int, seen: int, reference: EncodedFrame) -> None:
        if self.mode is _Mode.FRAME:
            if self.sending:
                self._transmitting(index, driven, seen)
            else:
                self._receiving(index, seen, reference)
        elif self.mode is _Mode.FLAG:
            self._flagging(seen)
        elif self.mode is _Mode.WAIT:
            if seen:
                self.mode, self.left = _Mode.DELIMITER, ERROR_DELIMITER_BITS - 1
            elif self.first_wait and not self.sending:
                self.result.dominant_after_flag = True
            self.first_wait = False
        elif self.mode is _Mode.DELIMITER:
            self.left -= 1
            if self.left == 0:
                self.mode = _Mode.REST
            elif not seen:
                self.raise_flag(ErrorKind.FORM)

    def _transmitting(self, index: int, driven: int, seen: int) -> None:
        frame = self.party.frame
        assert frame is not None
        if index == frame.ack_slot:
            if seen:
                self.raise_flag(ErrorKind.ACK)
        elif seen != driven:
            if index < frame.arbitration_end and driven:
                if index in frame.stuffed:  # rule c, exception 2
                    self.raise_flag(ErrorKind.STUFF, counts=False)
                else:  # it believes that another node won
                    self.sending, self.wrong = False, True
                    self.run, self.last = 1, seen
                return
            self.raise_flag(ErrorKind.BIT)
        elif index == len(frame.bits) - 1:
            self.result.done = True
            self.mode = _Mode.REST

    def _receiving(self, index: int, seen: int, reference: EncodedFrame) -> None:
        self.run = self.run + 1 if seen == self.last else 1
        before, self.last = self.last, seen
        if index < reference.dynamic_end:
            if self.run > 5:
                self.raise_flag(ErrorKind.STUFF)
                return
            self.wrong = self.wrong or seen != reference.bits[index]
        elif index < reference.crc_delimiter:
            if index in reference.stuffed and seen == before:
                self.raise_flag(ErrorKind.FORM)
                return
            self.wrong = self.wrong or seen != reference.bits[index]
        elif index != reference.ack_slot:
            self._trailing(index, seen, reference)

    def _trailing(self, index: int, seen: int, reference: EncodedFrame) -> None:
        """CRC delimiter, ACK delimiter, end of frame: all recessive."""
        last = len(reference.bits) - 1
        if index == last:
            self.result.done = True  # valid for a receiver up to the last but one bit
            if seen:
                self.mode = _Mode.REST
            else:
                self.raise_flag(None)
        elif not seen:
            self.raise_flag(ErrorKind.FORM)
        elif self.wrong and index == reference.ack_slot + 1:
            self.raise_flag(ErrorKind.CRC)

    def _flagging(self, seen: int) -> None:
        if self.party.passive or self.party.listen_only:  # done after six equal bits, whoever sends them
            self.run = self.run + 1 if seen == self.last else 1
            self.last = seen
            finished = self.run == ERROR_FLAG_BITS
        else:
            self.left -= 1
            finished = self.left == 0
        if finished:
            self.mode, self.first_wait = _Mode.WAIT, True


def run_attempt(parties: Mapping[int, Party], flips: Mapping[int, int | None]) -> AttemptOutcome:
    """Send what the senders among `parties` send, all from the same SOF and with equal arbitration fields.

    `flips` maps a bit index to the node that alone sees it flipped, or None for all. Ends when every node rests,
    or when the frame is over and only error-passive nodes still wait for silence.
    """
    frames = [party.frame for party in parties.values() if party.frame is not None]
    reference = min(frames, key=lambda frame: frame.bits)  # the one whose bits the wire shows longest
    nodes = {number: _Node(party, party.frame is not None) for number, party in parties.items()}
    limit = len(reference.bits) + _BIT_LIMIT_AFTER_FRAME
    detected: int | None = None
    index = 0
    while index < limit:
        driven = [node.drives(index, reference) for node in nodes.values()]
        wire = min(driven)
        is_flipped = index in flips
        for (number, node), own in zip(nodes.items(), driven, strict=True):
            seen = wire ^ 1 if is_flipped and flips[index] in (None, number) else wire
            node.observe(index, own, seen, reference)
            if detected is None and node.result.error is not None and not _is_silent(node):
                detected = index
        index += 1
        if _is_over(nodes):
            break
    return AttemptOutcome({number: node.result for number, node in nodes.items()}, detected, index)


def _is_silent(node: _Node) -> bool:
    """A receiver whose error the wire does not show."""
    return not node.sending and (node.party.passive or node.party.listen_only)


def _is_over(nodes: Mapping[int, _Node]) -> bool:
    """Nobody will disturb the wire any more: all rest who could, or simply all."""
    somebody_loud, all_rest = False, True
    for node in nodes.values():  # one that is not over is mostly seen at the first: the sender
        if node.mode is not _Mode.REST:
            if not _is_silent(node):
                return False
            all_rest = False
        elif not _is_silent(node):
            somebody_loud = True
    return somebody_loud or all_rest
