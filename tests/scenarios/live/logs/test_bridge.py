"""hilscenario.live.logs.bridge: the bridge's rows as signals, and what their gaps say."""

from __future__ import annotations

from hilscenario.live.logs.bridge import missing_ticks, put_bridge
from hilscenario.signals.tracks import Tracks
from tests.scenarios.made import tick

MS = 1_000_000


def test_a_bridge_that_says_nothing_for_100_ms_asks_for_nothing() -> None:
    tracks = Tracks()
    put_bridge(tracks, [tick(0, "ACT"), tick(40, "ACT"), tick(300, "ACT")], [])
    assert tracks.events["gate.act"] == [(0.0, True), (140.0, False), (300.0, True), (400.0, False)]
    assert [value for _, value in tracks.events["gate.reason"]] == ["none", "silent", "none", "silent"]


def test_a_bridge_that_is_hung_is_known_to_be() -> None:
    tracks = Tracks()
    put_bridge(tracks, [tick(0, "ACT"), tick(300, "ACT")], [(20 * MS, "hung")])
    assert [value for _, value in tracks.events["gate.reason"]][:3] == ["none", "hung", "none"]
    assert tracks.events["gate.act"][:3] == [(0.0, True), (20.0, False), (300.0, True)]


def test_a_hang_took_effect_as_often_as_ticks_are_missing() -> None:
    ticks = [tick(k * 40, "ACT") for k in range(10)]
    assert missing_ticks(ticks, 0, 400 * MS) == 0
    assert missing_ticks([*ticks[:2], *ticks[7:]], 80 * MS, 280 * MS) == 5
    assert missing_ticks(ticks, 81 * MS, 110 * MS) == 0
