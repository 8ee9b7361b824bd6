"""What the terminal is told: a wrong key, a second bridge, a lone bus, a slow camera, a stop and the way out of it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hilbridge.runtime.account.notices import Facts, Notices

S = 1_000_000_000
WELL = Facts(0, "vcan0", False, False, 0, ("Follow", "None"), False, 0, 0, True, None)


def told(*, seconds: int = 8, **wrong: object) -> list[str]:
    """Each second of a run in which `wrong` holds."""
    notices, said = Notices(), []
    for now in range(seconds):
        grows: dict[str, object] = {"heard": 100 * now, "pictures": 25 * now}
        said += notices.look(replace(WELL, now_ns=now * S, **{**grows, **wrong}))  # type: ignore[arg-type]
    return said


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"refused": True}, "the device rejects ours"),
        ({"heard": 0, "device": None}, "alone, nobody sends or acknowledges"),
        ({"device": None}, "none of a device"),
        ({"device": ("EStop", "StopReceived")}, "run again with --clear-latch"),
        ({"device": ("EStop", "StopReceived"), "clearing": True}, "confirm at the device now"),
        ({"device": ("Latched", "OwnIdSeen"), "clearing": False}, "asking it"),
    ],
)
def test_each_trouble_is_one_line_however_long_it_lasts(wrong: dict[str, object], said: str) -> None:
    lines = told(**wrong)
    assert len(lines) == 1
    assert said in lines[0]


def test_nothing_is_said_where_all_is_well_nor_in_a_short_run() -> None:
    assert told() == []
    assert told(seconds=1, heard=0, device=None) == []


def test_a_second_bridge_and_a_slow_camera_are_seen_by_their_counts() -> None:
    notices, said = Notices(), []
    for now in range(12):
        facts = replace(WELL, now_ns=now * S, heard=100 * now, foreign=25 * min(now, 4), pictures=10 * now)
        said += notices.look(facts)
    assert [line.split(":")[0] for line in said] == ["second bridge", "camera", "over after 4.00 s"]
