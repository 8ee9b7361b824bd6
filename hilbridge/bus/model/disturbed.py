"""Attempts that do not go through: from the nodes of a medium to the bit-by-bit play and back."""

from __future__ import annotations

from collections.abc import Sequence

from hilbridge.bus.model.attempt import Party, PartyResult, run_attempt
from hilbridge.bus.model.bits import ERROR_DELIMITER_BITS, ERROR_FLAG_BITS, FrameLength, encode
from hilbridge.bus.model.error_frames import ErrorKind
from hilbridge.bus.model.faults import FaultState, flipped_bit
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.nodes import Node

_BITS_AFTER_ACK_SLOT = 1 + 7  # ACK delimiter and end of frame


def unacknowledged(senders: Sequence[Node], listeners: Sequence[Node]) -> tuple[dict[int, PartyResult], int]:
    """A frame that nobody acknowledges, and how many bits longer than a good one the attempt is.

    An error flag and its delimiter take the place of ACK delimiter and end of frame. A passive sender's flag is
    recessive: those who only listen see a frame without fault.
    """
    parties = {
        node.number: PartyResult(error=ErrorKind.ACK, counts_transmit=1, unacknowledged=True) for node in senders
    }
    silent = all(node.confinement.is_passive for node in senders)
    for node in listeners:
        heard = PartyResult(done=True) if silent else PartyResult(error=ErrorKind.FORM, counts_receive=1)
        parties[node.number] = heard
    return parties, ERROR_FLAG_BITS + ERROR_DELIMITER_BITS - _BITS_AFTER_ACK_SLOT


def flips_of(
    state: FaultState, frame: WireFrame, listeners: Sequence[Node], length: FrameLength, start_ns: int
) -> dict[int, int | None]:
    """Bits of this frame that are seen wrong, and by which node alone (None: by everybody)."""
    flips: dict[int, int | None] = {}
    bits = length.nominal_bits + length.data_bits
    position = state.random_error(bits)
    while position is not None:
        flips[position] = state.random_receiver([node.number for node in listeners])
        further = state.random_error(bits - position - 1)
        position = None if further is None else position + 1 + further
    if state.any_corruption:
        corruption = state.corruption(frame.can_id, start_ns, {node.name for node in listeners})
        if corruption is not None:
            alone = [node.number for node in listeners if node.name == corruption.receiver]
            flips[flipped_bit(corruption.bit, encode(frame))] = alone[0] if alone else None
    return flips


def play(
    senders: Sequence[Node], listeners: Sequence[Node], flips: dict[int, int | None]
) -> tuple[dict[int, PartyResult], int, int]:
    """Play a disturbed attempt; gives what became of each node, and its bits at the nominal and the data bit rate."""
    parties: dict[int, Party] = {}
    for node in senders:
        assert node.sending is not None
        parties[node.number] = Party(encode(node.sending.frame), node.confinement.is_passive)
    # Receivers that see the same bits in the same state do the same: one of each kind is played for all of them.
    alone = set(flips.values())
    alike: dict[Party | int, list[int]] = {}
    for node in listeners:
        party = Party(None, node.confinement.is_passive, node.acknowledges, node.listen_only)
        kind = alike.setdefault(node.number if node.number in alone else party, [])
        if not kind:
            parties[node.number] = party
        kind.append(node.number)
    outcome = run_attempt(parties, flips)
    first = parties[senders[0].number].frame
    assert first is not None
    # An error in the data phase of an FD frame ends that phase.
    begin, end = first.data_phase
    last = outcome.end_bit if outcome.detected_bit is None else outcome.detected_bit + 1
    data_bits = max(0, min(end, last) - begin)
    results = {node.number: outcome.parties[node.number] for node in senders}
    results |= {number: outcome.parties[kind[0]] for kind in alike.values() for number in kind}
    return results, outcome.end_bit - data_bits, data_bits
