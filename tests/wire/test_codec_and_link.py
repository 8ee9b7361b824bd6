"""The bridge's codec against cantools, its E2E against vectors, its errors against a stranger's eye."""

from __future__ import annotations

import random
import re
from pathlib import Path
from typing import Any

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.records import Frame
from hilbridge.wire import e2e
from hilbridge.wire.codec import Codec, Decoded, Rejected, RejectReason
from hilbridge.wire.dbc import REQUIRED, DbcError, default_dbc_path
from hilbridge.wire.e2e import CheckStatus, MachineState, ReceiverState
from hilbridge.wire.link import WireLink

requirement = pytest.mark.requirement
CODEC = Codec()
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


@requirement("P11")
def test_the_dbc_carries_cycles_timeouts_start_values_and_data_ids() -> None:
    cycles = {name: message.cycle_ms for name, message in CODEC.messages.items() if message.cycle_ms}
    assert cycles == {
        "ACT_CMD": 40,
        "CTRL_STATUS": 20,
        "CTRL_MEAS": 20,
        "BRIDGE_HB": 80,
        "CTRL_HB": 100,
        "BRIDGE_DIAG": 40,
        "CTRL_DIAG": 34,
    }
    timeouts = {name: message.timeout_ms for name, message in CODEC.messages.items() if message.timeout_ms}
    assert (timeouts["ACT_CMD"], timeouts["ACT_AUTH"], timeouts["CTRL_STATUS"], timeouts["BRIDGE_HB"]) == (
        100,
        10,
        60,
        250,
    )
    ids = [message.data_id for message in CODEC.messages.values() if message.data_id is not None]
    assert len(ids) == len(set(ids)) == 12
    assert CODEC.messages["STOP"].length == 0
    start = CODEC.decode(Frame(0x60, CODEC.encode("ACT_CMD", {})))
    assert isinstance(start, Decoded)
    assert start.signals == {
        "Gate": "Hold",
        "Verb": "None",
        "Confidence": 0,
        "Session": 0,
        "Echo": 0,
        "SensingAge": 510,
    }


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
def test_h9_decode_never_raises(can_id: int, data: bytes, error: bool, fd: bool, extended: bool, remote: bool) -> None:
    frame = Frame(can_id, data, is_error=error, is_fd=fd, is_extended=extended, is_remote=remote)
    link = WireLink(CODEC)
    for outcome in (CODEC.decode(frame), link.decode(frame)):
        assert isinstance(outcome, (Decoded, Rejected))
        if error or fd or extended or remote:
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


@pytest.mark.parametrize("name", sorted(REQUIRED))
def test_a_dbc_lacking_a_message_is_one_line_naming_it(name: str, tmp_path: Path) -> None:
    text = default_dbc_path().read_text()
    can_id = CODEC.messages[name].can_id
    text = re.sub(rf"^BO_ {can_id} .*?\n\n", "", text, flags=re.S | re.M)
    text = "\n".join(
        line
        for line in text.splitlines()
        if not re.match(rf'(CM_ (BO_|SG_)|BA_ "\w+" (BO_|SG_)|VAL_|BO_TX_BU_) {can_id}\b', line)
    )
    path = tmp_path / "site.dbc"
    path.write_text(text + "\n")
    with pytest.raises(DbcError) as raised:
        Codec(path)
    line = str(raised.value)
    assert line.startswith(f"{path}: message {name} is missing")
    assert "\n" not in line


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        (" SG_ Echo :", " SG_ Ekho :", "message ACT_CMD lacks signal Echo"),
        ('BA_ "E2EDataId" BO_ 96 4192;\n', "", "message ACT_CMD lacks the attribute E2EDataId"),
        (" SG_ Freshness : 24|8@1+", " SG_ Freshness : 31|8@0+", "message ACT_AUTH has big-endian signals"),
        ("BO_ 96 ACT_CMD: 8", "BO_ 96 ACT_CMD: 9", "cannot carry E2E profile 5"),
        ("NS_ :", "NS_ ((", "not a DBC file"),
    ],
)
def test_a_dbc_that_cannot_be_used_is_one_line(old: str, new: str, error: str, tmp_path: Path) -> None:
    text = default_dbc_path().read_text()
    assert old in text
    path = tmp_path / "site.dbc"
    changed = text.replace(old, new)
    if "Ekho" in new:
        changed = changed.replace("SG_ 96 Echo", "SG_ 96 Ekho")
    path.write_text(changed)
    with pytest.raises(DbcError) as raised:
        Codec(path)
    assert error in str(raised.value)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_dbc_that_is_not_there_and_nested_multiplexers(tmp_path: Path) -> None:
    with pytest.raises(DbcError, match="no such DBC file"):
        Codec(tmp_path / "none.dbc")
    path = tmp_path / "nested.dbc"
    text = default_dbc_path().read_text()
    path.write_text(text.replace(" SG_ Angle m0 :", " SG_ Angle m0M :"))
    with pytest.raises(DbcError, match="nested multiplexers"):
        Codec(path)


def test_a_site_may_renumber_a_value_table(tmp_path: Path) -> None:
    path = tmp_path / "site.dbc"
    path.write_text(default_dbc_path().read_text().replace('1 "Take" 2 "Put"', '2 "Take" 1 "Put"'))
    site = Codec(path)
    assert site.encode("ACT_CMD", {"Verb": "Take"}) == CODEC.encode("ACT_CMD", {"Verb": "Put"})


# The link: counters, sequence, state machine


def status(link: WireLink, **signals: Any) -> Frame:
    return link.encode("CTRL_STATUS", signals)


@requirement("P8", "P9")
def test_the_link_counts_every_drop_under_its_reason() -> None:
    device, bridge = WireLink(CODEC, "CONTROLLER"), WireLink(CODEC)
    first = status(device, State="Follow")
    assert isinstance(bridge.decode(first), Decoded)
    again = bridge.decode(first)
    assert isinstance(again, Rejected)
    assert again.reason is RejectReason.REPEATED
    bad = Frame(first.can_id, first.data[:7] + bytes((first.data[7] ^ 1,)))
    assert bridge.decode(bad).reason is RejectReason.CRC  # type: ignore[union-attr]
    for _ in range(3):
        status(device)
    assert isinstance(bridge.decode(status(device)), Decoded)
    assert bridge.counters["LostFrames"] == 3
    for _ in range(6):
        status(device)
    assert bridge.decode(status(device)).reason is RejectReason.SEQUENCE  # type: ignore[union-attr]
    assert bridge.decode(Frame(0xA0, b"")).reason is RejectReason.LENGTH  # type: ignore[union-attr]
    assert bridge.counters["RxAccepted"] == 2
    assert sum(bridge.counters.values()) == 7 - 1 + 3


@requirement("P1")
def test_an_invalid_machine_drops_frames_until_trust_is_earned() -> None:
    device, bridge = WireLink(CODEC, "CONTROLLER"), WireLink(CODEC)
    for _ in range(2):
        bridge.decode(status(device))
    assert bridge.machine("CTRL_STATUS") is MachineState.VALID
    assert bridge.machine("CTRL_MEAS") is MachineState.NO_DATA
    for _ in range(2):
        bridge.decode(Frame(0xA0, bytes(8)))
    assert bridge.machine("CTRL_STATUS") is MachineState.INVALID
    outcomes = [bridge.decode(status(device)) for _ in range(4)]
    assert [isinstance(outcome, Decoded) for outcome in outcomes] == [False, False, False, True]
    assert bridge.counters["RejE2EState"] == 3


def test_own_messages_from_outside_are_no_message_of_a_device() -> None:
    other, bridge = WireLink(CODEC), WireLink(CODEC)
    outcome = bridge.decode(other.encode("ACT_CMD", {}))
    assert isinstance(outcome, Rejected)
    assert outcome.reason is RejectReason.UNKNOWN_ID


@requirement("P3")
def test_stop_carries_nothing_and_is_always_taken() -> None:
    link = WireLink(CODEC)
    stop = link.encode("STOP", {})
    assert (stop.can_id, stop.data) == (1, b"")
    for _ in range(3):
        outcome = link.decode(stop)
        assert isinstance(outcome, Decoded)
        assert outcome.name == "STOP"


# E2E on the bridge


@requirement("P1")
@pytest.mark.parametrize(
    ("data", "crc"),
    [("00000000", 0x84C0), ("f20183", 0xD374), ("0faa0055", 0x2023), ("00ff5511", 0xB8F9), ("ffffffff", 0x1D0F)],
)
def test_crc_vectors_of_autosar(data: str, crc: int) -> None:
    # The Data ID enters low byte first: with the vector's last two bytes as Data ID the CRC is the vector's.
    raw = bytes.fromhex(data)
    assert e2e.crc(b"\0\0" + raw[:-2], int.from_bytes(raw[-2:], "little")) == crc


@requirement("P1")
def test_protect_vector_of_profile_5() -> None:
    assert e2e.protect(bytes(8), 0x1234, 0).hex() == "1cca000000000000"
    assert e2e.protect(bytes(8), 0x1234, 256).hex() == "1cca000000000000"


@pytest.mark.parametrize(
    ("delta", "status"),
    [
        (0, CheckStatus.REPEATED),
        (1, CheckStatus.OK),
        (2, CheckStatus.SOME_LOST),
        (3, CheckStatus.SOME_LOST),
        (4, CheckStatus.WRONG_SEQUENCE),
        (255, CheckStatus.WRONG_SEQUENCE),
    ],
)
def test_sequence(delta: int, status: CheckStatus) -> None:
    before = ReceiverState(254, MachineState.VALID, (CheckStatus.OK,), 5)
    found, after = e2e.check(e2e.protect(bytes(8), 7, 254 + delta), 7, 3, before)
    assert found is status
    assert after.counter == (254 + delta) % 256
    assert after.lost == 5 + (delta - 1 if status is CheckStatus.SOME_LOST else 0)
    assert after.window == (CheckStatus.OK, status)


def test_errors_move_no_counter_and_short_data_is_an_error() -> None:
    before = ReceiverState(9, MachineState.VALID, (CheckStatus.OK, CheckStatus.OK), 1)
    right_crc_of_nothing = e2e.crc(b"", 7).to_bytes(2, "little")
    for data in (bytes(8), b"", b"\xff", b"\xff\xff", right_crc_of_nothing):
        found, after = e2e.check(data, 7, 3, before)
        assert found is CheckStatus.ERROR
        assert (after.counter, after.lost) == (9, 1)
    found, after = e2e.check(e2e.protect(bytes(3), 7, 10), 7, 3, before)  # the shortest that holds a counter
    assert (found, after.counter) == (CheckStatus.OK, 10)
    assert ReceiverState().lost == 0


OK, E, R, N, L, W = (
    CheckStatus.OK,
    CheckStatus.ERROR,
    CheckStatus.REPEATED,
    CheckStatus.NO_NEW_DATA,
    CheckStatus.SOME_LOST,
    CheckStatus.WRONG_SEQUENCE,
)


@requirement("P10")
@given(st.lists(st.sampled_from([OK, E, R, N, L, W]), max_size=12))
def test_both_sides_run_the_same_state_machine(results: list[CheckStatus]) -> None:
    from firmware_sim import e2e as device

    theirs = {OK: device.Check.OK, E: device.Check.ERROR, R: device.Check.REPEATED, N: device.Check.NO_NEW_DATA}
    theirs |= {L: device.Check.OK_SOME_LOST, W: device.Check.WRONG_SEQUENCE}
    mine, other = ReceiverState(), device.Receiver()
    for result in results:
        mine = e2e.advance(mine, result)
        other = device.advance(other, theirs[result])
        assert mine.machine.name == other.machine.name
        assert len(mine.window) == len(other.window)


def test_a_full_window_of_good_frames_keeps_the_machine_valid_or_makes_it_so() -> None:
    for machine in (MachineState.INIT, MachineState.VALID, MachineState.INVALID):
        before = ReceiverState(7, machine, (OK, OK, OK, OK), 3)
        assert e2e.advance(before, OK) == ReceiverState(7, MachineState.VALID, (OK, OK, OK, OK), 3)


@pytest.mark.parametrize(
    ("results", "machine"),
    [
        ((E,), MachineState.NO_DATA),
        ((N,), MachineState.NO_DATA),
        ((OK,), MachineState.INIT),
        ((OK, R), MachineState.INIT),
        ((OK, L), MachineState.VALID),
        ((OK, E, OK), MachineState.VALID),
        ((OK, E, E), MachineState.INVALID),
        ((OK, OK, E), MachineState.VALID),
        ((OK, OK, E, E), MachineState.INVALID),
        ((OK, OK, E, OK, OK, OK, E), MachineState.VALID),
        ((OK, OK, R, R, R), MachineState.VALID),
        ((OK, OK, W, W, W, W), MachineState.INVALID),
        ((OK, OK, OK, OK, OK, E), MachineState.VALID),
        ((OK, OK, OK, OK, OK, E, E), MachineState.INVALID),
        ((OK, OK, OK, OK, OK, R, R, R, R), MachineState.INVALID),
        ((OK, OK, E, E, OK, OK, OK), MachineState.INVALID),
        ((OK, OK, E, E, OK, OK, OK, OK), MachineState.VALID),
        ((OK, OK, R, R, R, R, OK), MachineState.INVALID),
        ((OK, OK, R, R, R, R, OK, L), MachineState.VALID),
    ],
)
def test_the_state_machine(results: tuple[CheckStatus, ...], machine: MachineState) -> None:
    state = ReceiverState()
    for result in results:
        state = e2e.advance(state, result)
    assert state.machine is machine
