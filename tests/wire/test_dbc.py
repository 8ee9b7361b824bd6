from __future__ import annotations

import re
from pathlib import Path

import pytest

from hilbridge.records import Frame
from hilbridge.wire.codec import Codec, Decoded
from hilbridge.wire.dbc import REQUIRED, DbcError, default_dbc_path
from tests.wire.shared import CODEC

requirement = pytest.mark.requirement


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
