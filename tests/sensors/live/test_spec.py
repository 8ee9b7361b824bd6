"""sensors.live.spec: what is live, and what is wrong in one line."""

from __future__ import annotations

import pytest

from hilbridge.errors import InputError
from hilbridge.sensors.live.lsl import LslChannels
from hilbridge.sensors.live.spec import is_live, open_live_gaze


@pytest.mark.parametrize(
    ("spec", "live"),
    [
        *[(spec, True) for spec in ("neon:", "neon:10.0.0.2", "lsl:Gaze", "udp:5005")],
        *[(spec, False) for spec in ("recordings/neon", "neon", "C:\\gaze.csv", "gaze.csv")],
    ],
)
def test_what_is_live(spec: str, live: bool) -> None:
    assert is_live(spec) is live


@pytest.mark.parametrize("spec", ["udp:", "udp:x", "udp:0", "udp:70000", "udp:127.0.0.1:"])
def test_a_port_that_is_none_is_one_line(spec: str) -> None:
    with pytest.raises(InputError, match="is no port"):
        open_live_gaze(spec, LslChannels(), 0)


def test_a_host_that_is_not_this_computers_is_one_line() -> None:
    with pytest.raises(InputError, match="name a port that is free"):
        open_live_gaze("udp:192.0.2.1:5005", LslChannels(), 0)
