"""Single attempts bit by bit: superposed flags, their exact lengths, who gets the frame, whatever bit is hit."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbridge.bus.model.attempt import Party, run_attempt
from hilbridge.bus.model.bits import encode
from hilbridge.bus.model.error_frames import ErrorKind
from hilbridge.bus.model.frames import DLC_LENGTHS, WireFrame

SENDER, ONE, TWO = 1, 2, 3
FRAME = encode(WireFrame(0x2AA, b"\x5a\xa5"))  # few stuff bits
FLAG, DELIMITER = 6, 8


def parties(*, sender_passive: bool = False, one_passive: bool = False) -> dict[int, Party]:
    return {SENDER: Party(FRAME, sender_passive), ONE: Party(None, one_passive), TWO: Party(None, False)}


def test_an_undisturbed_attempt_ends_with_the_frame() -> None:
    outcome = run_attempt(parties(), {})
    assert all(result.done and result.error is None for result in outcome.parties.values())
    assert (outcome.detected_bit, outcome.end_bit) == (None, len(FRAME.bits))


def test_nobody_acknowledges() -> None:
    silent = {SENDER: Party(FRAME, False), ONE: Party(None, False, acknowledges=False)}
    outcome = run_attempt(silent, {})
    assert outcome.parties[SENDER].error is ErrorKind.ACK
    assert outcome.parties[SENDER].unacknowledged
    assert outcome.parties[ONE].error is ErrorKind.FORM  # it sees the flag where the ACK delimiter should be
    # The sender's flag follows the ACK slot; the other sees it one bit later and adds its own: seven dominant bits.
    assert outcome.end_bit == FRAME.ack_slot + 1 + FLAG + 1 + DELIMITER


def test_a_stuff_error_after_a_bit_error_superposes_the_flags() -> None:
    # Everybody sees a data bit flipped: the sender's six dominant bits make the others' sixth equal bit at the latest,
    # then they send six more: a dominant phase of seven to twelve bits, then the delimiter.
    hit = (FRAME.arbitration_end + FRAME.checksum_start) // 2
    outcome = run_attempt(parties(), {hit: None})
    assert outcome.parties[SENDER].error is ErrorKind.BIT
    assert outcome.parties[ONE].error is ErrorKind.STUFF
    assert outcome.detected_bit == hit
    assert hit + 1 + FLAG + 1 + DELIMITER <= outcome.end_bit <= hit + 1 + 2 * FLAG + DELIMITER


def test_a_crc_error_of_one_receiver_shows_after_the_ack_delimiter() -> None:
    outcome = run_attempt(parties(), {FRAME.checksum_start + 3: ONE})
    first = outcome.parties[ONE]
    assert first.error is ErrorKind.CRC
    assert first.dominant_after_flag  # rule b: the others' flags still go on when its own is over
    assert not outcome.parties[TWO].dominant_after_flag
    assert outcome.detected_bit == FRAME.ack_slot + 1
    assert outcome.end_bit == FRAME.ack_slot + 2 + FLAG + 1 + DELIMITER


def test_a_passive_receiver_spoils_nothing() -> None:
    outcome = run_attempt(parties(one_passive=True), {FRAME.checksum_start + 3: ONE})
    assert outcome.parties[SENDER].done
    assert outcome.parties[TWO].done
    assert not outcome.parties[ONE].done
    assert outcome.parties[ONE].counts_receive == 1
    assert not outcome.parties[ONE].dominant_after_flag
    assert outcome.detected_bit is None


def test_a_passive_senders_flag_is_seen_as_a_stuff_error() -> None:
    outcome = run_attempt(parties(sender_passive=True), {FRAME.arbitration_end + 9: None})
    assert outcome.parties[SENDER].error is ErrorKind.BIT
    assert outcome.parties[ONE].error is ErrorKind.STUFF
    assert outcome.parties[ONE].counts_receive == 1


def test_a_sender_that_loses_arbitration_to_a_flipped_bit_counts_no_transmit_error() -> None:
    recessive = next(
        index for index in range(1, FRAME.arbitration_end) if FRAME.bits[index] and index not in FRAME.stuffed
    )
    outcome = run_attempt(parties(), {recessive: None})
    assert outcome.parties[SENDER].counts_transmit == 0
    assert not any(result.done for result in outcome.parties.values())


def test_a_flipped_stuff_bit_in_the_identifier_is_exception_two() -> None:
    frame = encode(WireFrame(0x000, b"\x00"))
    stuff_bit = min(frame.stuffed)
    assert frame.bits[stuff_bit] == 1
    outcome = run_attempt({SENDER: Party(frame, False), ONE: Party(None, False)}, {stuff_bit: None})
    assert outcome.parties[SENDER].error is ErrorKind.STUFF
    assert outcome.parties[SENDER].counts_transmit == 0
    assert outcome.parties[ONE].counts_receive == 1


def test_collision_of_one_identifier_is_a_bit_error_of_the_recessive_sender() -> None:
    low, high = encode(WireFrame(0x100, b"\x00")), encode(WireFrame(0x100, b"\xff"))
    outcome = run_attempt({1: Party(low, False), 2: Party(high, False), 3: Party(None, False)}, {})
    assert outcome.parties[2].error is ErrorKind.BIT
    assert outcome.parties[1].error is ErrorKind.BIT  # it meets the other's flag
    assert not any(result.done for result in outcome.parties.values())


@st.composite
def wire_frames(draw: st.DrawFn) -> WireFrame:
    extended, is_fd = draw(st.booleans()), draw(st.booleans())
    length = draw(st.sampled_from(DLC_LENGTHS[:12])) if is_fd else draw(st.integers(0, 8))
    can_id = draw(st.integers(0, 0x1FFF_FFFF if extended else 0x7FF))
    data = bytes(draw(st.lists(st.sampled_from([0, 255, 0x55, 0x0F]), min_size=length, max_size=length)))
    return WireFrame(can_id, data, extended, is_fd, is_fd and draw(st.booleans()))


@given(wire_frames(), st.data())
@settings(max_examples=150)
def test_one_flipped_bit_never_leaves_active_nodes_of_two_minds(frame: WireFrame, data: st.DataObject) -> None:
    """Either the sender and all are content, or the sender repeats; only the last bit may give a frame twice."""
    encoded = encode(frame)
    hit = data.draw(st.integers(0, len(encoded.bits) - 1))
    victim = data.draw(st.sampled_from([None, ONE, TWO]))
    nodes = {SENDER: Party(encoded, False), ONE: Party(None, False), TWO: Party(None, False)}
    outcome = run_attempt(nodes, {hit: victim})
    content = [outcome.parties[number].done for number in (ONE, TWO)]
    if outcome.parties[SENDER].done:
        assert all(content)
    elif any(content):
        assert hit >= len(encoded.bits) - 2
    assert outcome.end_bit < len(encoded.bits) + 40
    if outcome.parties[SENDER].error is not None and outcome.parties[SENDER].error is not ErrorKind.STUFF:
        assert outcome.parties[SENDER].counts_transmit + outcome.parties[SENDER].counts_receive >= 1


@given(
    wire_frames(),
    st.dictionaries(st.integers(0, 200), st.sampled_from([None, SENDER, ONE, TWO]), max_size=6),
    st.tuples(st.booleans(), st.booleans(), st.booleans()),
)
@settings(max_examples=150)
def test_whatever_is_flipped_every_attempt_ends(
    frame: WireFrame, flips: dict[int, int | None], passive: tuple[bool, bool, bool]
) -> None:
    encoded = encode(frame)
    nodes = {
        SENDER: Party(encoded, passive[0]),
        ONE: Party(None, passive[1]),
        TWO: Party(None, passive[2], acknowledges=False, listen_only=True),
    }
    outcome = run_attempt(nodes, flips)
    assert outcome.end_bit < len(encoded.bits) + 200
    assert all(result.counts_transmit >= 0 for result in outcome.parties.values())


@pytest.mark.parametrize("last", [-1, -2])
def test_an_error_at_the_very_end(last: int) -> None:
    outcome = run_attempt(parties(), {len(FRAME.bits) + last: ONE})
    if last == -1:  # an overload condition for a receiver: it has the frame, and so has everybody
        assert all(result.done for result in outcome.parties.values())
        assert outcome.parties[ONE].error is None
    else:  # its flag meets the sender's last bit: the sender repeats what the other receiver has already
        assert not outcome.parties[SENDER].done
        assert not outcome.parties[ONE].done
        assert outcome.parties[TWO].done
