"""bus.port.options: what `--bus-option` may say, and that it reaches python-can."""

from __future__ import annotations

from typing import Any

import can
import pytest

from hilbridge.bus.port.options import checked_options
from hilbridge.bus.port.spec import BusUnavailable, parse_spec
from hilbridge.config import BusConfig, parse_options
from hilbridge.errors import InputError
from hilbridge.runtime.assemble import open_port


def test_values_are_numbers_truths_filters_or_words() -> None:
    given = [
        "bitrate=500000",
        "fd=true",
        "timing=0.875",
        "app_name=Mine",
        "can_filters=[{can_id=0xA0, can_mask=0x7FF}]",
    ]
    assert parse_options([*given, "tty=/dev/ttyACM0"]) == {
        "bitrate": 500_000,
        "fd": True,
        "timing": 0.875,
        "app_name": "Mine",
        "can_filters": [{"can_id": 0xA0, "can_mask": 0x7FF}],
        "tty": "/dev/ttyACM0",
    }


@pytest.mark.parametrize("text", ["bitrate", "=5", "bit rate=5", ""])
def test_what_is_no_key_and_value_is_one_line(text: str) -> None:
    with pytest.raises(InputError, match="write KEY=VALUE"):
        parse_options([text])


@pytest.mark.parametrize(
    ("spec", "options", "said"),
    [
        ("can0", {"bitrate": 500_000}, "ip link set can0"),
        ("hilsim:demo", {"fd": True}, "no option fd"),
        ("hilsim:demo", {"bitrate": "fast"}, "no whole number"),
        ("slcan:/dev/ttyACM0", {"channel": "x"}, "--bus INTERFACE:CHANNEL"),
        ("virtual:x", {"receive_own_messages": True}, "must not hear itself"),
    ],
)
def test_what_would_be_ignored_or_do_harm_is_one_line(spec: str, options: dict[str, Any], said: str) -> None:
    with pytest.raises(BusUnavailable, match=said) as refused:
        checked_options(parse_spec(spec), options)
    assert "\n" not in str(refused.value)


async def test_they_reach_python_can(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: dict[str, Any] = {}
    real = can.Bus

    def bus(**given: Any) -> can.BusABC:
        seen.update(given)
        return real(interface="virtual", channel="options")

    monkeypatch.setattr(can, "Bus", bus)
    config = BusConfig(
        spec="virtual:options", options={"bitrate": 250_000, "can_filters": [{"can_id": 1, "can_mask": 7}]}
    )
    async with open_port(config, None):
        pass
    assert seen == {
        "interface": "virtual",
        "channel": "options",
        "bitrate": 250_000,
        "can_filters": [{"can_id": 1, "can_mask": 7}],
    }
