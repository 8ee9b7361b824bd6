"""sensors.live.neon with the vendor's own client, against a phone that is played."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from hilbridge.config import SensorsConfig
from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.records import GazeSample, StampSource
from hilbridge.runtime.health import gaze_seen, sensor_problem
from hilbridge.sensors.source import SourceState

pytest.importorskip("pupil_labs.realtime_api")

from hilbridge.sensors.live.neon import NeonGaze
from tests.sensors.live.fake_neon import FakeNeon


class Watched:
    """A running source, its events, and the moments at which it could not be believed."""

    def __init__(self, phone: FakeNeon) -> None:
        self.events: list[str] = []
        self.samples: list[tuple[int, GazeSample]] = []
        self.source = NeonGaze(f"127.0.0.1:{phone.port}")
        self.source.on_event = self.events.append
        self.source.on_value = lambda sample: self.samples.append((time.monotonic_ns(), sample))

    def problem(self) -> str | None:
        source = self.source
        seen = gaze_seen(SensorsConfig(), source.state is SourceState.RUNNING, source.last_captured_ns, live=True)
        return sensor_problem(seen, time.monotonic_ns())

    @property
    def good(self) -> list[GazeSample]:
        return [sample for _, sample in list(self.samples) if sample.valid]


def until(condition: Callable[[], object], seconds: float = 60.0) -> None:
    end_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end_s, "it never came about"
        threading.Event().wait(0.005)


@contextmanager
def watched(phone: FakeNeon) -> Iterator[Watched]:
    one = Watched(phone)
    one.source.start()
    try:
        until(lambda: len(one.good) > 5 and one.problem() is None)
        yield one
    finally:
        one.source.stop(10.0)


@pytest.fixture
def phone() -> Iterator[FakeNeon]:
    with FakeNeon() as one:
        yield one


def test_gaze_comes_on_this_computers_clock(phone: FakeNeon) -> None:
    with watched(phone) as one:
        until(lambda: len(one.samples) > 100)
        assert one.source.clock is not None
        assert one.source.clock.fit is not None
        wrong_ns = one.source.clock.fit.to_local(phone.wall_ns()) - time.monotonic_ns()
        assert abs(wrong_ns) < 10 * MS
        ages_ms = sorted((at_ns - sample.captured_ns) / MS for at_ns, sample in one.samples[-50:])
        assert -1 <= ages_ms[0] <= ages_ms[25] < 60
    assert {(round(sample.x, 3), round(sample.y, 3), sample.stamp) for sample in one.good} == {
        (0.5, 0.5, StampSource.RTCP)
    }
    assert one.events[-1].endswith("gaze comes")


def test_an_invisible_has_a_scene_of_its_own() -> None:
    with FakeNeon(version="1", x=544.0, y=270.0) as phone, watched(phone) as one:
        assert one.source.glasses.name == "Pupil Invisible"
        assert (one.good[-1].x, one.good[-1].y) == (0.5, 0.25)


def test_a_blink_masks_and_is_over(phone: FakeNeon) -> None:
    phone.lids_mm = 9.0
    with watched(phone) as one:
        phone.lids_mm = 0.5
        until(lambda: not one.samples[-1][1].valid)
        assert one.problem() is None  # a blink is no dropout
        phone.lids_mm = 9.0
        until(lambda: one.samples[-1][1].valid)


def test_glasses_off_the_head_are_gone_until_worn_again(phone: FakeNeon) -> None:
    with watched(phone) as one:
        phone.worn = False
        until(lambda: one.problem() is not None)
        phone.worn = True
        until(lambda: one.problem() is None)
    assert one.events[-2:] == [f"{one.source.name}: the glasses are not worn", f"{one.source.name}: gaze comes"]


def test_a_network_that_swallows_everything_is_seen_and_comes_back(phone: FakeNeon) -> None:
    with watched(phone) as one:
        phone.silent = True
        until(lambda: one.problem() is not None)
        until(lambda: any("no gaze for" in text for text in one.events))
        phone.silent = False
        until(lambda: one.problem() is None)
    assert one.events[-1].endswith("gaze comes")


def test_a_device_that_is_started_anew_is_found_again() -> None:
    with contextlib.ExitStack() as phones:
        first = FakeNeon()
        with first:
            one = phones.enter_context(watched(first))
        until(lambda: one.problem() is not None)
        until(lambda: any("does not answer" in text for text in one.events))
        with first.again() as second:
            until(lambda: one.problem() is None)
            assert second.sent > 0
            phones.close()
    assert one.events[-1].endswith("gaze comes")


def test_glasses_that_are_unplugged_are_said(phone: FakeNeon) -> None:
    with watched(phone) as one:
        phone.connected, phone.silent = False, True
        until(lambda: any("no gaze for" in text for text in one.events))
        phone.silent = False
        until(lambda: any("no glasses are plugged" in text for text in one.events))
        phone.connected = True
        until(lambda: one.problem() is None)


@pytest.mark.parametrize("step_ms", [-5_000, -80, 80, 5_000])
def test_a_clock_that_is_set_holds_and_is_learnt_again(phone: FakeNeon, step_ms: int) -> None:
    with watched(phone) as one:
        phone.skew_ns += step_ms * MS
        until(lambda: any("clock was set" in text or "from now" in text for text in one.events))
        until(lambda: one.problem() is None and one.events[-1].endswith("gaze comes"))
        until(lambda: len(one.samples) > 200)
        assert one.source.clock is not None
        assert one.source.clock.fit is not None
        assert abs(one.source.clock.fit.to_local(phone.wall_ns()) - time.monotonic_ns()) < 10 * MS


@pytest.mark.parametrize(("host", "said"), [("127.0.0.1:1", "does not answer"), ("127.0.0.1:x", "is no port")])
def test_nobody_there_is_one_line(host: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as refused:
        NeonGaze(host)
    assert "\n" not in str(refused.value)


def test_unknown_glasses_are_refused() -> None:
    with FakeNeon(version="unknown") as phone, pytest.raises(InputError, match="known kind"):
        NeonGaze(f"127.0.0.1:{phone.port}")
