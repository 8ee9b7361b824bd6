from __future__ import annotations

import re
from pathlib import Path

import pytest

from firmware_sim.frames import FIELDS, RESERVED_MASK
from hilbridge.records import Frame
from hilbridge.wire.codec import Codec, Decoded
from hilbridge.wire.dbc import REQUIRED, DbcError, Signal, default_dbc_path
from tests.safety.wire.conformance import fields_of
from tests.wire.shared import CODEC

requirement = pytest.mark.requirement
ROOT = Path(__file__).parents[2]


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
        (' SG_ Counter : 16|8@1+ (1,0) [0|255] "" CONTROLLER\n SG_ Gate', " SG_ Gate", "cannot carry E2E profile 5"),
        ("NS_ :", "NS_ ((", "not a DBC file"),
    ],
    ids=["signal", "attribute", "big-endian", "length", "header", "syntax"],  # by hand: a `|` in a name ends it
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


def test_a_file_read_anew_has_the_layout_that_the_device_has_by_hand() -> None:
    codec = Codec()
    for can_id, expected in FIELDS.items():
        layout = codec.by_id[can_id]
        for group in layout.groups or (None,):
            fields = fields_of(layout, (0 if group is None else group,))
            content = layout.contents[group]
            assert content.reserved_bits == RESERVED_MASK[can_id]
            assert set(layout.contents) == set(layout.groups or (None,))
            for field, signal, reading in zip(expected, fields, content.readings, strict=True):
                assert (signal.start, signal.bits) == (field.start, field.bits)
                assert signal.is_signed == (field.lowest < 0)
                assert (reading.name, reading.start, reading.mask) == (signal.name, field.start, (1 << field.bits) - 1)
                assert reading.sign == (1 << (field.bits - 1) if field.lowest < 0 else 0)
                assert (reading.lowest, reading.highest) == (signal.lowest, signal.highest)
                if signal is layout.multiplexer:
                    assert set(layout.groups) == set(range(field.highest + 1))
                elif field.allowed is None:
                    assert (signal.lowest, signal.highest) == (field.lowest, field.highest)
                else:
                    assert signal.names is not None
                    assert set(signal.names) == set(field.allowed)
    assert codec.messages["STOP"].contents[None] == (0, ())


def test_numbers_of_a_file_read_anew_are_as_it_has_them() -> None:
    messages = Codec().messages
    angle = messages["CTRL_MEAS"].groups[0][0]
    assert (angle.scale, angle.offset, type(angle.offset)) == (0.25, -30, int)
    assert type(messages["ACT_CMD"].signals[-1].scale) is int
    assert [messages[name].cycle_ms for name in ("ACT_CMD", "STOP")] == [40, 0]
    assert [messages[name].timeout_ms for name in ("ACT_CMD", "STOP", "ARM_REQUEST")] == [100, 0, 0]
    assert [messages[name].max_delta for name in ("ACT_CMD", "CTRL_STATUS", "STOP")] == [3, 5, 1]
    assert messages["BRIDGE_DIAG"].signals == (messages["BRIDGE_DIAG"].multiplexer,)
    # A value table alone makes no signal one that is only valid by its names.
    assert messages["ACT_CMD"].signals[-1].names is None
    assert messages["ACT_CMD"].signals[-1].codes == {"Unknown": 255}


def test_what_is_not_told_to_be_enumerated_is_not(tmp_path: Path) -> None:
    path = tmp_path / "site.dbc"
    told = 'BA_ "Enumerated" SG_ 96 Gate 1;'
    path.write_text(default_dbc_path().read_text().replace(told, told.replace(" 1;", " 0;")))
    assert Codec(path).messages["ACT_CMD"].signals[0].names is None


@pytest.mark.parametrize(("value", "offset", "raw"), [(10, 10, 0), (9, -1, 10), (0.0, 0, 0)])
def test_an_offset_is_taken_off_where_the_scale_is_one(value: float, offset: int, raw: int) -> None:
    signal = Signal("X", 24, 8, False, 1, offset, 0, 255, None, None, 0)
    assert signal.to_raw(value) == raw


@pytest.mark.parametrize(("word", "value"), [(0x7F, 127), (0x80, -128), (0xFF, -1), (0x1FF, -1)])
def test_a_signed_value_comes_out_of_its_bits(word: int, value: int) -> None:
    signal = Signal("X", 24, 8, True, 1, 0, -128, 127, None, None, 0)
    assert signal.raw(word << 24) == value


def test_the_shipped_file_is_beside_the_code_and_says_what_the_one_in_dbc_says() -> None:
    assert default_dbc_path().name == "iassistadl.dbc"
    assert default_dbc_path().read_text() == (ROOT / "dbc" / "iassistadl.dbc").read_text()
