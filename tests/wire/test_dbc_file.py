"""What is wrong with a DBC file is said with its line; encodings of the field are read."""

from __future__ import annotations

from pathlib import Path

import pytest

from hilbridge.wire.dbc_file import DbcError, load_dbc, read_text, same_identifier, shown_number

HEAD = 'VERSION ""\nBU_: A\n'
MESSAGE = 'BO_ 100 M: 8 A\n SG_ S : 0|8@1+ (1,0) [0|255] "" A\n'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (HEAD + MESSAGE.replace("100", "418448384"), "more than 11 bits in message M (line 3)"),
        (HEAD + MESSAGE + 'BA_ "Colour" BO_ 100 5;\n', "'Colour' is used but not defined (line 5)"),
        (HEAD + MESSAGE + 'VAL_ 100 Gone 0 "off" ;\n', "Gone of message 100 (line 5)"),
        (HEAD + "BO_ 100 5M: 8 A\n", "invalid syntax at line 3"),
        (HEAD, "holds no message"),
        ("this is no DBC", "no DBC file"),
        ("", "no DBC file"),
    ],
)
def test_the_reason_and_the_line(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "x.dbc"
    path.write_text(text)
    with pytest.raises(DbcError) as caught:
        load_dbc(path)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_byte_order_mark_and_windows_letters_are_read(tmp_path: Path) -> None:
    path = tmp_path / "x.dbc"
    path.write_bytes(b"\xef\xbb\xbf" + (HEAD + MESSAGE).encode())
    assert [message.name for message in load_dbc(path).messages] == ["M"]
    path.write_bytes((HEAD + MESSAGE).replace('"" A', '"\xb0C" A').encode("cp1252"))
    assert load_dbc(path).messages[0].signals[0].unit == "\xb0C"
    assert read_text(path).startswith("VERSION")


def test_one_number_is_base_and_extended_apart(tmp_path: Path) -> None:
    path = tmp_path / "x.dbc"
    path.write_text(HEAD + MESSAGE + MESSAGE.replace("100 M", "2147483748 N"))
    assert same_identifier(load_dbc(path).messages) == {}
    path.write_text(HEAD + MESSAGE + MESSAGE.replace("100 M", "100 N"))
    assert same_identifier(load_dbc(path).messages) == {100: ["M", "N"]}
    assert (shown_number(100), shown_number(1 << 31 | 100)) == ("0x064", "0x00000064")
