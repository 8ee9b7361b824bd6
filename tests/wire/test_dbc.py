from __future__ import annotations

import re
from pathlib import Path

import pytest

from firmware_sim.frames import FIELDS, RESERVED_MASK
from hilbridge.records import Frame
from hilbridge.wire.codec import Codec, Decoded
from hilbridge.wire.dbc import REQUIRED, Signal, default_dbc_path
from hilbridge.wire.dbc_file import DbcError
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
        ("NS_ :", "NS_ ((", "invalid syntax at line 3"),
        (" SG_ Verb : 26|5@1+ (1,0)", " SG_ Verb : 26|5@1+ (0,0)", "message ACT_CMD has a signal of scale 0"),
        ("BA_DEF_ BO_", "SIG_VALTYPE_ 289 BootNonce : 1;\nBA_DEF_ BO_", "message CTRL_HB has floating-point signals"),
    ],
    ids=[
        "signal",
        "attribute",
        "big-endian",
        "length",
        "header",
        "syntax",
        "scale",
        "float",
    ],  # by hand: a `|` in a name ends it
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


def test_without_a_range_the_bits_are_the_range_and_offsets_count(tmp_path: Path) -> None:
    path = tmp_path / "site.dbc"
    text = default_dbc_path().read_text()
    for old, new in (
        ("[0|100]", "[0|0]"),
        ("[-1024|1022]", "[0|0]"),
        ("(0.25,-30) [-30|225.75]", "(0.25,-30.5) [0|225.25]"),
        ("BO_ 32 CTRL_EMCY", 'BO_ 1000 SITE: 1 BRIDGE\n SG_ X : 1|7@1+ (1,0) [0|0] "" CONTROLLER\n\nBO_ 32 CTRL_EMCY'),
    ):
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    messages = Codec(path).messages
    confidence = messages["ACT_CMD"].signals[2]
    angle, velocity = messages["CTRL_MEAS"].groups[0][:2]
    assert (confidence.name, confidence.lowest, confidence.highest) == ("Confidence", 0, 127)
    assert (velocity.name, velocity.lowest, velocity.highest) == ("Velocity", -512, 511)
    assert (angle.offset, angle.lowest, angle.highest) == (-30.5, 122, 1023)
    # A message without E2E has no header: its first bit is one like any other, and unused here.
    assert messages["SITE"].contents[None].reserved_bits == 1


@pytest.mark.parametrize(
    ("layout", "lowest", "highest"),
    [
        ("(-1,100) [0|100]", 0, 100),
        ("(-1,100) [-10|70]", 30, 110),
        ("(-2,0) [-100|0]", 0, 50),
        ("(0.5,0) [0|10]", 0, 20),
        ("(1,0) [0|1e999]", 0, 127),
        ("(1,0) [-1e999|9]", 0, 9),
        ("(-1,0) [-1e999|-9]", 9, 127),
    ],
    ids=["falling", "falling, cut", "falling by 2", "half", "no end", "no beginning", "falling, no end"],  # see above
)
def test_a_range_holds_whichever_way_the_scale_points_and_an_infinite_one_limits_nothing(
    layout: str, lowest: int, highest: int, tmp_path: Path
) -> None:
    path = tmp_path / "site.dbc"
    text = default_dbc_path().read_text()
    assert " SG_ Confidence : 31|7@1+ (1,0) [0|100]" in text
    path.write_text(text.replace("Confidence : 31|7@1+ (1,0) [0|100]", f"Confidence : 31|7@1+ {layout}"))
    confidence = Codec(path).messages["ACT_CMD"].signals[2]
    assert (confidence.name, confidence.lowest, confidence.highest) == ("Confidence", lowest, highest)


def test_a_file_without_any_attribute_says_which_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "site.dbc"
    lines = default_dbc_path().read_text().splitlines()
    path.write_text("\n".join(line for line in lines if not line.startswith(("BA_", "CM_"))) + "\n")
    with pytest.raises(DbcError, match="lacks the attribute E2EDataId"):
        Codec(path)


def site_dbc(path: Path, messages: str, rest: str = "") -> Path:
    """The shipped DBC with messages of the site in front of ours, and lines at its end."""
    text = default_dbc_path().read_text()
    path.write_text(text.replace("BO_ 1 STOP", f"{messages}\n\nBO_ 1 STOP", 1) + rest + "\n")
    return path


@pytest.mark.parametrize("base", [0x001, 0x0A0])
def test_an_extended_message_of_our_number_changes_nothing(base: int, tmp_path: Path) -> None:
    theirs = f'BO_ {base | 1 << 31} SITE: 8 CONTROLLER\n SG_ T : 0|8@1+ (1,0) [0|255] "" BRIDGE'
    codec = Codec(site_dbc(tmp_path / "site.dbc", theirs))
    assert len(codec.messages) == len(CODEC.messages) + 1
    assert {number: codec.by_id[number].name for number in CODEC.by_id} == {
        number: message.name for number, message in CODEC.by_id.items()
    }
    assert isinstance(codec.decode(Frame(0x001, b"")), Decoded)


@pytest.mark.parametrize(
    ("message", "rest"),
    [
        ('BO_ 1792 OTHER: 8 CONTROLLER\n SG_ S : 7|16@0+ (1,0) [0|65535] "" BRIDGE', ""),
        (
            'BO_ 1792 OTHER: 8 CONTROLLER\n SG_ A M : 0|8@1+ (1,0) [0|9] "" BRIDGE\n'
            ' SG_ B m0M : 8|8@1+ (1,0) [0|9] "" BRIDGE\n SG_ C m1 : 16|8@1+ (1,0) [0|9] "" BRIDGE',
            "SG_MUL_VAL_ 1792 B A 0-0;\nSG_MUL_VAL_ 1792 C B 1-1;",
        ),
        (
            'BO_ 1792 OTHER: 8 CONTROLLER\n SG_ A : 0|16@1+ (1,0) [0|9] "" BRIDGE\n'
            ' SG_ B : 8|8@1+ (1,0) [0|9] "" BRIDGE',
            "",
        ),
        ('BO_ 1792 OTHER: 8 CONTROLLER\n SG_ F : 0|32@1- (0.01,0) [-1.7E+308|1.7E+308] "" BRIDGE', ""),
        ('BO_ 1792 OTHER: 8 CONTROLLER\n SG_ F : 0|32@1- (1,0) [0|0] "" BRIDGE', "SIG_VALTYPE_ 1792 F : 1;"),
        ('BO_ 1792 OTHER: 8 CONTROLLER\n SG_ F : 60|16@1+ (0,0) [0|1] "" BRIDGE', ""),
        ('BO_ 2566834709 LONG: 20 CONTROLLER\n SG_ S : 0|8@1+ (1,0) [0|255] "" BRIDGE', ""),
    ],
)
def test_what_others_send_does_not_matter(message: str, rest: str, tmp_path: Path) -> None:
    codec = Codec(site_dbc(tmp_path / "site.dbc", message, rest))
    assert set(CODEC.messages) <= set(codec.messages)
    assert codec.encode("ACT_CMD", {"Gate": "Hold"}) == CODEC.encode("ACT_CMD", {"Gate": "Hold"})


def test_a_message_of_ours_that_is_extended_or_fd_is_refused_by_name(tmp_path: Path) -> None:
    text = default_dbc_path().read_text()
    path = tmp_path / "site.dbc"
    path.write_text(re.sub(r"\b(BO_|SG_|VAL_) 96\b", lambda found: f"{found[1]} {0x18FF6001 | 1 << 31}", text))
    with pytest.raises(DbcError, match="ACT_CMD has the extended identifier 0x18ff6001"):
        Codec(path)
    formats = '"StandardCAN","ExtendedCAN","StandardCAN_FD"'
    fd = f'BA_DEF_ BO_ "VFrameFormat" ENUM {formats};\nBA_DEF_DEF_ "VFrameFormat" "StandardCAN";\n'
    path.write_text(text + fd + 'BA_ "VFrameFormat" BO_ 96 2;\n')
    with pytest.raises(DbcError, match=r"ACT_CMD \(0x060\) is CAN FD"):
        Codec(path)


def test_two_messages_of_one_identifier_are_named(tmp_path: Path) -> None:
    theirs = 'BO_ 96 THEIRS: 8 CONTROLLER\n SG_ T : 0|8@1+ (1,0) [0|255] "" BRIDGE'
    with pytest.raises(DbcError, match="THEIRS and ACT_CMD have one identifier 0x060"):
        Codec(site_dbc(tmp_path / "site.dbc", theirs))


def test_overlapping_signals_of_ours_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "site.dbc"
    path.write_text(default_dbc_path().read_text().replace(" SG_ Freshness : 24|8@1+", " SG_ Freshness : 28|8@1+"))
    with pytest.raises(DbcError, match="overlapping in message ACT_AUTH"):
        Codec(path)
