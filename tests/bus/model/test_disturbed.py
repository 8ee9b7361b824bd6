"""Receivers that do the same are played once: what comes of it is what playing each of them would give."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from hilbridge.bus.model.attempt import Party, run_attempt
from hilbridge.bus.model.bits import encode
from hilbridge.bus.model.disturbed import play
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.nodes import Node, Queued, QueueOrder

FRAME = WireFrame(0x2AA, b"\x5a\xa5")
KINDS = st.tuples(st.booleans(), st.booleans(), st.booleans())


def node(number: int, passive: bool, acknowledges: bool, listen_only: bool) -> Node:
    made = Node(number, f"node {number}", listen_only, 10, QueueOrder.FIFO, True, acknowledges)
    made.confinement.rec = 128 if passive else 0
    return made


@given(
    st.booleans(),
    st.lists(KINDS, min_size=1, max_size=8),
    st.dictionaries(st.integers(0, 70), st.none() | st.integers(2, 9), max_size=3),
)
def test_playing_one_of_a_kind_gives_what_playing_all_gives(
    passive: bool, kinds: list[tuple[bool, bool, bool]], flips: dict[int, int | None]
) -> None:
    sender = node(1, passive, True, False)
    sender.sending = Queued(0, 0, FRAME, 0)
    listeners = [node(number, *kind) for number, kind in enumerate(kinds, 2)]
    results, nominal_bits, data_bits = play([sender], listeners, flips)
    parties = {1: Party(encode(FRAME), passive)}
    parties |= {
        each.number: Party(None, each.confinement.is_passive, each.acknowledges, each.listen_only) for each in listeners
    }
    outcome = run_attempt(parties, flips)
    assert results == outcome.parties
    assert nominal_bits + data_bits == outcome.end_bit
