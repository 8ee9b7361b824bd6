"""Frame lengths at worst, held against the model bit by bit; FD and long messages of a DBC."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.bus.analysis import analyse, as_text
from hilbridge.bus.message_set import read_message_set, worst_fd_bits, worst_frame_bits
from hilbridge.bus.model.bits import INTERMISSION_BITS, frame_length
from hilbridge.bus.model.frames import DLC_LENGTHS, WireFrame
from hilbridge.errors import InputError

FD_DBC = """VERSION ""
BU_: A
BO_ 100 Fast: 64 A
 SG_ S : 0|8@1+ (1,0) [0|255] "" A
BO_ 101 Short: 8 A
 SG_ S : 0|8@1+ (1,0) [0|255] "" A
BO_ 2566834709 Long: 20 A
 SG_ S : 0|8@1+ (1,0) [0|255] "" A
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","StandardCAN_FD";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 101 2;
"""


@given(st.sampled_from(DLC_LENGTHS), st.booleans(), st.data())
def test_no_fd_frame_is_longer_than_its_bound(length: int, extended: bool, data: st.DataObject) -> None:
    can_id = data.draw(st.integers(0, 0x1FFF_FFFF if extended else 0x7FF))
    payload = data.draw(st.one_of(st.just(bytes(length)), st.binary(min_size=length, max_size=length)))
    exact = frame_length(WireFrame(can_id, payload, extended, is_fd=True, bit_rate_switch=True))
    nominal, fast = worst_fd_bits(length, extended=extended)
    assert exact.nominal_bits + INTERMISSION_BITS <= nominal
    # A stuff bit that is not spent before BRS may fall after it: only the sum is a bound at equal rates.
    assert exact.nominal_bits + INTERMISSION_BITS + exact.data_bits <= nominal + fast


def test_fd_is_computed_with_its_data_bit_rate_and_long_messages_are_left_out_by_name(tmp_path: Path) -> None:
    path = tmp_path / "fd.dbc"
    path.write_text(FD_DBC)
    found = read_message_set(path)
    assert [(entry.name, entry.is_fd) for entry in found.streams] == [("Fast", True), ("Short", True)]
    assert "20 bytes" in found.left_out["Long"]
    slow, fast = analyse(path, 500_000), analyse(path, 500_000, data_bitrate=2_000_000)
    assert fast["messages"][0]["worst_case_latency_ms"] < slow["messages"][0]["worst_case_latency_ms"]
    nominal, data = worst_fd_bits(64)
    short_ns = sum(bits * ns for bits, ns in zip(worst_fd_bits(8), (2000, 500), strict=True))
    assert fast["messages"][0]["worst_case_latency_ms"] == (nominal * 2000 + data * 500 + short_ns) / 1e6
    assert "give --data-bitrate" in as_text(slow)
    assert "left out: Long" in as_text(fast)
    with pytest.raises(InputError, match="data bit rate 1"):
        analyse(path, 500_000, data_bitrate=1)


def test_the_data_bit_rate_of_the_dbc_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "fd.dbc"
    rate = 'BA_DEF_ "BaudrateCANFD" INT 0 8000000;\nBA_DEF_DEF_ "BaudrateCANFD" 0;\nBA_ "BaudrateCANFD" 2000000;\n'
    path.write_text(FD_DBC + rate)
    assert analyse(path, 500_000)["data_bitrate"] == 2_000_000


def test_two_messages_of_one_identifier_are_named_and_base_and_extended_are_two(tmp_path: Path) -> None:
    path = tmp_path / "x.dbc"
    path.write_text(FD_DBC.replace("BO_ 101 Short", "BO_ 100 Short"))
    with pytest.raises(InputError, match="Fast and Short have one identifier 0x064"):
        read_message_set(path)
    path.write_text(FD_DBC.replace("2566834709 Long: 20", "2147483748 Long: 8"))
    assert [entry.is_extended for entry in read_message_set(path).streams] == [False, False, True]
    assert worst_frame_bits(8, extended=True) == next(
        entry["frame_bits"] for entry in analyse(path, 500_000)["messages"] if entry["name"] == "Long"
    )
