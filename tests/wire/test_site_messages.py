"""A site's own messages beside the bridge's: what ails them is told, and only the bridge's own must be right."""

from __future__ import annotations

from pathlib import Path

import pytest

from hilbridge.records import Frame
from hilbridge.verbs import DEFAULT, VERBS
from hilbridge.wire.codec import Codec, Decoded, Rejected, RejectReason
from hilbridge.wire.dbc import DbcError, default_dbc_path
from tests.wire.shared import CODEC

PLAIN = 'BO_ {number} {name}: 8 SITE\n SG_ Value : 24|8@1+ (1,0) [0|255] "" Vector__XXX\n'


def codec_with(folder: Path, *messages: tuple[int, str]) -> Codec:
    path = folder / "site.dbc"
    text = default_dbc_path().read_text(encoding="utf-8")
    text += "".join("\n" + PLAIN.format(number=number, name=name) for number, name in messages)
    path.write_text(text, encoding="utf-8")
    return Codec(path)


def test_two_messages_of_a_site_may_share_what_they_like(tmp_path: Path) -> None:
    codec = codec_with(tmp_path, (0x6F0, "One"), (0x6F0, "Other"), (0x6F1, "One"))
    decoded = codec.decode(Frame(0x6F0, bytes(8)))
    assert isinstance(decoded, Decoded)


def test_a_message_without_e2e_has_no_counter(tmp_path: Path) -> None:
    decoded = codec_with(tmp_path, (0x6F0, "One")).decode(Frame(0x6F0, bytes(3) + b"\xff" + bytes(4)))
    assert isinstance(decoded, Decoded)
    assert (decoded.counter, decoded.signals) == (0, {"Value": 255})


@pytest.mark.parametrize("again", [1, 2])
def test_a_message_of_the_bridge_is_there_once(tmp_path: Path, again: int) -> None:
    with pytest.raises(DbcError, match=f"message ACT_CMD is there {again + 1} times"):
        codec_with(tmp_path, *((0x6F0 + number, "ACT_CMD") for number in range(again)))


def test_the_bridges_identifiers_are_its_own(tmp_path: Path) -> None:
    taken = CODEC.messages["ACT_CMD"].can_id
    with pytest.raises(DbcError, match="ACT_CMD and One have one identifier"):
        codec_with(tmp_path, (taken, "One"))


@pytest.mark.parametrize(("error", "told"), [(ValueError("too long"), "too long"), (KeyError(), "KeyError")])
def test_what_cannot_be_read_of_a_site_is_left_out_and_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, told: str
) -> None:
    def unreadable(message: object, path: Path) -> None:
        raise error

    monkeypatch.setattr("hilbridge.wire.codec.read_message", unreadable)
    codec = codec_with(tmp_path, (0x6F0, "One"))
    assert codec.left_out == {"One": told}
    outcome = codec.decode(Frame(0x6F0, bytes(8)))
    assert isinstance(outcome, Rejected)
    assert outcome.reason is RejectReason.UNKNOWN_ID


def test_the_verbs_are_those_of_the_value_table() -> None:
    assert {DEFAULT.wire_name(VERBS.index(verb)) for verb in DEFAULT.assisted} | {"None"} <= CODEC.verbs
    assert "Hold" not in CODEC.verbs
    assert len(CODEC.verbs) < 100


def test_a_verb_without_a_table_says_nothing(tmp_path: Path) -> None:
    path = tmp_path / "bare.dbc"
    lines = default_dbc_path().read_text(encoding="utf-8").splitlines(keepends=True)
    number = CODEC.messages["ACT_CMD"].can_id
    bare = [line for line in lines if not line.startswith(f"VAL_ {number} Verb ")]
    assert len(bare) == len(lines) - 1
    path.write_text("".join(bare), encoding="utf-8")
    assert Codec(path).verbs == frozenset()


def test_a_stop_is_one_in_any_form_and_an_error_frame_none() -> None:
    stop = CODEC.messages["STOP"].can_id
    forms = [Frame(stop, b""), Frame(stop, b"", is_remote=True), Frame(stop, bytes(12), is_fd=True)]
    for frame in (*forms, Frame(stop, bytes(8), is_extended=True)):
        decoded = CODEC.decode(frame)
        assert isinstance(decoded, Decoded)
        assert decoded.name == "STOP"
    wrong = CODEC.decode(Frame(stop, bytes(8), is_error=True))
    assert isinstance(wrong, Rejected)
    assert wrong.reason is RejectReason.KIND
