from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import cantools
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hilbridge.records import Frame
from hilbridge.wire.codec import Codec, Decoded, Rejected, RejectReason
from hilbridge.wire.dbc import REQUIRED, DbcError, default_dbc_path
from hilbridge.wire.link import WireLink
from tests.wire.shared import CODEC

requirement = pytest.mark.requirement


DATABASE: Any = cantools.database.load_file(str(default_dbc_path()))


def random_signals(message: Any, rng: random.Random) -> dict[str, Any]:
    """Values cantools and the codec must agree on: one multiplexer group, every enumerated name possible."""
    layout = CODEC.messages[message.name]
    signals: dict[str, Any] = {}
    fields = layout.signals
    if layout.multiplexer is not None:
        group = rng.choice(sorted(layout.groups))
        signals[layout.multiplexer.name] = (layout.multiplexer.names or {}).get(group, group)
        fields = tuple(f for f in fields if f is not layout.multiplexer) + layout.groups[group]
    for field in fields:
        if field.names is not None:
            signals[field.name] = rng.choice(sorted(field.names.values()))
        else:
            signals[field.name] = rng.randint(field.lowest, field.highest) * field.scale + field.offset
    return signals


@requirement("P10")
@pytest.mark.parametrize("name", sorted(REQUIRED))
def test_codec_and_cantools_agree_both_ways(name: str) -> None:
    message, rng = DATABASE.get_message_by_name(name), random.Random(name)
    for _ in range(200):
        signals = random_signals(message, rng)
        data = CODEC.encode(name, signals)
        header = {} if name == "STOP" else {"CRC": 0, "Counter": 0}
        assert data == message.encode({**signals, **header}, strict=False)
        decoded = CODEC.decode(Frame(message.frame_id, data))
        assert isinstance(decoded, Decoded)
        theirs = {k: v for k, v in message.decode(data, decode_choices=False).items() if k not in header}
        for key, value in decoded.signals.items():
            if isinstance(value, str):
                assert message.get_signal_by_name(key).choice_to_number(value) == theirs[key]
            else:
                assert value == pytest.approx(theirs[key])


@requirement("P4")
def test_one_flipped_bit_of_the_gate_is_never_the_other_action() -> None:
    gate = CODEC.messages["ACT_CMD"].signals[0]
    assert gate.names == {1: "Hold", 2: "Act"}
    assert bin(1 ^ 2).count("1") == 2


@given(st.sampled_from(sorted(REQUIRED)), st.data())
def test_decoding_by_plan_says_what_each_signal_says(name: str, data: st.DataObject) -> None:
    """Any payload, against the signals asked one by one."""
    layout = CODEC.messages[name]
    payload = data.draw(st.binary(min_size=layout.length, max_size=layout.length))
    word, fields, used = int.from_bytes(payload, "little"), layout.signals, 0xFFFFFF if layout.length else 0
    outcome = CODEC.decode(Frame(layout.can_id, payload))
    if layout.multiplexer is not None:
        group = layout.multiplexer.raw(word)
        if group not in layout.groups:
            assert isinstance(outcome, Rejected)
            assert outcome.reason is RejectReason.MUX
            return
        fields += layout.groups[group]
    expected: dict[str, Any] = {}
    wrong = None
    for field in fields:
        used |= ((1 << field.bits) - 1) << field.start
        raw = field.raw(word)
        if field.names is not None:
            wrong = wrong or (None if raw in field.names else RejectReason.ENUM)
            expected[field.name] = field.names.get(raw)
        else:
            wrong = wrong or (None if field.lowest <= raw <= field.highest else RejectReason.RANGE)
            expected[field.name] = raw * field.scale + field.offset
    wrong = RejectReason.RESERVED if word & ~used else wrong
    if wrong is None:
        assert isinstance(outcome, Decoded)
        assert outcome.signals == expected
    else:
        assert isinstance(outcome, Rejected)
        assert outcome.reason is wrong


@requirement("P9")
@given(st.integers(0, 0x7FF), st.binary(max_size=64), st.booleans(), st.booleans(), st.booleans(), st.booleans())
@example(0x001, b"", False, False, False, True)
@example(0x001, b"", True, False, False, True)
@example(0x002, b"", False, False, False, True)
def test_h9_decode_never_raises(can_id: int, data: bytes, error: bool, fd: bool, extended: bool, remote: bool) -> None:
    frame = Frame(can_id, data, is_error=error, is_fd=fd, is_extended=extended, is_remote=remote)
    link = WireLink(CODEC)
    for outcome in (CODEC.decode(frame), link.decode(frame)):
        assert isinstance(outcome, (Decoded, Rejected))
        if can_id == 0x001 and not error:  # a STOP in any form
            assert isinstance(outcome, Decoded)
        elif error or fd or extended or remote:
            assert isinstance(outcome, Rejected)
            assert outcome.reason is RejectReason.KIND
        assert outcome.frame is frame
    assert sum(link.counters.values()) == 1


@requirement("P9")
@pytest.mark.parametrize(
    ("name", "bit", "width", "value", "reason"),
    [
        ("ACT_CMD", 24, 2, 3, RejectReason.ENUM),
        ("ACT_CMD", 31, 7, 101, RejectReason.RANGE),
        ("ACT_CMD", 62, 2, 2, RejectReason.RESERVED),
        ("CTRL_STATUS", 24, 4, 9, RejectReason.ENUM),
        ("CTRL_STATUS", 63, 1, 1, RejectReason.RESERVED),
        ("CTRL_MEAS", 24, 4, 1, RejectReason.MUX),
        ("CTRL_DIAG", 24, 8, 29, RejectReason.MUX),
        ("CTRL_HB", 24, 8, 0, RejectReason.RANGE),
    ],
)
def test_content_outside_the_dbc_is_rejected(name: str, bit: int, width: int, value: int, reason: RejectReason) -> None:
    word = int.from_bytes(CODEC.encode(name, {}), "little") & ~(((1 << width) - 1) << bit) | value << bit
    outcome = CODEC.decode(Frame(CODEC.messages[name].can_id, word.to_bytes(8, "little")))
    assert isinstance(outcome, Rejected)
    assert (outcome.reason, outcome.name) == (reason, name)


def test_lengths_and_strangers_are_rejected() -> None:
    for can_id, data, reason in (
        (0x60, b"", RejectReason.LENGTH),
        (0x60, bytes(9), RejectReason.LENGTH),
        (0x7FF, bytes(8), RejectReason.UNKNOWN_ID),
    ):
        outcome = CODEC.decode(Frame(can_id, data))
        assert isinstance(outcome, Rejected)
        assert outcome.reason is reason


@pytest.mark.parametrize(
    ("message", "signals", "error"),
    [
        ("ACT_CMD", {"Gate": "Maybe"}, "value table"),
        ("ACT_CMD", {"Gate": 3}, "outside"),
        ("ACT_CMD", {"Gate": 0}, "outside"),
        ("ACT_CMD", {"Verb": 22}, "outside"),
        ("ACT_CMD", {"Confidence": 101}, "outside"),
        ("ACT_CMD", {"Confidence": -1}, "outside"),
        ("ACT_CMD", {"Confidence": "high"}, "value table"),
        ("ACT_CMD", {"Colour": 1}, "no signal Colour"),
        ("CTRL_MEAS", {"Angle": 300.0}, "outside"),
    ],
)
def test_encode_refuses_what_the_dbc_does_not_allow(message: str, signals: dict[str, Any], error: str) -> None:
    with pytest.raises(ValueError, match=error):
        CODEC.encode(message, signals)


def test_encode_knows_names_and_numbers() -> None:
    assert CODEC.encode("ACT_CMD", {"Verb": "Pour", "SensingAge": "Unknown"}) == CODEC.encode(
        "ACT_CMD", {"Verb": 10, "SensingAge": 510}
    )
    with pytest.raises(KeyError):
        CODEC.encode("NO_SUCH", {})


def test_a_reason_is_the_name_of_its_counter() -> None:
    """As BRIDGE_DIAG has them, in the order of its indices."""
    index = CODEC.messages["BRIDGE_DIAG"].multiplexer
    assert index is not None
    assert index.names is not None
    assert [index.names[code] for code in range(1, 12)] == [reason.value for reason in RejectReason]


def test_a_codec_made_anew_finds_messages_by_identifier_and_counters_in_frames() -> None:
    codec = Codec()
    data = codec.encode("ACT_CMD", {})
    outcome = codec.decode(Frame(0x060, data[:2] + bytes((255,)) + data[3:]))
    assert isinstance(outcome, Decoded)
    assert (outcome.name, outcome.counter) == ("ACT_CMD", 255)
    stop = codec.decode(Frame(0x001, b""))
    assert isinstance(stop, Decoded)
    assert stop.counter == 0


@pytest.mark.parametrize("frame", [Frame(0x7FF, b""), Frame(0x060, bytes(8), is_fd=True)])
def test_what_has_no_message_names_none(frame: Frame) -> None:
    outcome = CODEC.decode(frame)
    assert isinstance(outcome, Rejected)
    assert outcome.name == ""


@pytest.mark.parametrize(("said", "shown"), [(ValueError("bad\nmore"), "bad"), (ValueError(), "ValueError")])
def test_a_parsers_first_line_is_shown_or_else_what_it_raised(
    said: Exception, shown: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise said

    monkeypatch.setattr("cantools.database.can.database.Database.add_dbc_string", fails)
    (tmp_path / "x.dbc").write_text("VERSION")
    with pytest.raises(DbcError) as raised:
        Codec(tmp_path / "x.dbc")
    assert shown in str(raised.value)
    assert "\n" not in str(raised.value)
