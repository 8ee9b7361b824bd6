"""sensors.live.lsl against a real outlet of the same machine."""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.records import GazeSample, StampSource
from hilbridge.sensors.live import lsl
from hilbridge.sensors.live.lsl import LslBody, LslChannels, LslGaze, triples
from hilbridge.sensors.source import SourceState
from tests.sensors.live.test_neon import until

pylsl = pytest.importorskip("pylsl")


class Tracker:
    """An outlet of four channels that pushes 100 samples a second until it is closed."""

    def __init__(self, name: str, source_id: str) -> None:
        info = pylsl.StreamInfo(name, "Gaze", 4, 100, "float32", source_id)
        channels = info.desc().append_child("channels")
        for label in ("x", "y", "confidence", "worn"):
            channels.append_child("channel").append_child_value("label", label)
        self.outlet = pylsl.StreamOutlet(info)
        self.sample = [400.0, 150.0, 1.0, 1.0]
        self.age_s = 0.0
        self.pushing = True
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._push, daemon=True)
        self._thread.start()

    def _push(self) -> None:
        while not self._closing.wait(0.01):
            if self.pushing:
                self.outlet.push_sample(self.sample, pylsl.local_clock() - self.age_s)

    def close(self) -> None:
        self._closing.set()
        self._thread.join()
        del self.outlet


NAMED = LslChannels("x", "y", width=800.0, height=600.0, y_up=True, valid="confidence", valid_from=0.6, worn="worn")


@contextmanager
def following(
    tracker: Tracker, spec: str, channels: LslChannels = NAMED
) -> Iterator[tuple[LslGaze, list[Any], list[str]]]:
    source, samples, events = LslGaze(spec, channels), list[tuple[int, GazeSample]](), list[str]()
    source.on_value = lambda sample: samples.append((time.monotonic_ns(), sample))
    source.on_event = events.append
    source.start()
    try:
        until(lambda: len(samples) > 5 and source.state is SourceState.RUNNING)
        yield source, samples, events
    finally:
        source.stop(10.0)


@pytest.fixture
def name() -> str:
    return f"gaze-{uuid.uuid4().hex[:8]}"


@pytest.fixture
def tracker(name: str) -> Iterator[Tracker]:
    one = Tracker(name, f"id-{name}")
    yield one
    one.close()


def test_samples_come_by_their_channels_on_this_computers_clock(tracker: Tracker, name: str) -> None:
    tracker.age_s = 0.02
    with following(tracker, name) as (_, samples, events):
        until(lambda: len(samples) > 30)
        sample = samples[-1][1]
    assert (sample.x, sample.y, sample.valid, sample.stamp) == (0.5, 0.75, True, StampSource.HARDWARE)
    ages_ms = sorted((at_ns - sample.captured_ns) / MS for at_ns, sample in samples)
    assert 19 <= ages_ms[0] < 60
    assert events == [f"gaze lsl:{name}: gaze comes"]


def test_confidence_masks_and_worn_holds(tracker: Tracker, name: str) -> None:
    with following(tracker, f"source_id=id-{name}") as (source, samples, events):
        tracker.sample = [400.0, 150.0, 0.5, 1.0]
        until(lambda: not samples[-1][1].valid)
        assert source.state is SourceState.RUNNING
        tracker.sample = [400.0, 150.0, 1.0, 0.0]
        until(lambda: source.state is SourceState.GONE)
        tracker.sample = [400.0, 150.0, 1.0, 1.0]
        until(lambda: source.state is SourceState.RUNNING)
    assert [text.rpartition(": ")[2] for text in events] == ["gaze comes", "the glasses are not worn", "gaze comes"]


def test_a_stream_that_falls_silent_and_one_that_is_started_anew(name: str) -> None:
    first = Tracker(name, f"id-{name}")
    with following(first, name) as (source, samples, _):
        first.pushing = False
        until(lambda: source.state is SourceState.GONE)
        first.pushing = True
        until(lambda: source.state is SourceState.RUNNING)
        first.close()
        until(lambda: source.state is SourceState.GONE)
        second = Tracker(name, f"id-{name}")
        count = len(samples)
        until(lambda: source.state is SourceState.RUNNING and len(samples) > count)
        second.close()


@pytest.mark.parametrize(
    ("spec", "channels", "said"),
    [
        ("nobody", LslChannels(), "no such stream"),
        ("colour=blue", LslChannels(), "write lsl:NAME"),
        ("NAME", LslChannels("pupil"), "no channel 'pupil' for x; set .sensors.lsl. x to one of x, y"),
        ("NAME", LslChannels(9), "no channel 9"),
    ],
)
def test_what_cannot_be_used_is_one_line(
    tracker: Tracker, name: str, monkeypatch: pytest.MonkeyPatch, spec: str, channels: LslChannels, said: str
) -> None:
    if spec == "nobody":
        monkeypatch.setattr(lsl, "_FIND_S", 0.2)
    with pytest.raises(InputError, match=said) as refused:
        LslGaze(spec.replace("NAME", name), channels)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("labels", "found"),
    [
        (["HAND_R_x", "HAND_R_y", "HAND_R_z"], {"HAND_R": (0, 1, 2)}),
        (["gyro", "acc.Z", "acc.Y", "acc.X"], {"acc": (3, 2, 1)}),
        (["x", "y", "z"], {"HAND": (0, 1, 2)}),
        (["", "", ""], {"HAND": (0, 1, 2)}),
        ([""] * 6, {"HAND 1": (0, 1, 2), "HAND 2": (3, 4, 5)}),
        (["a_x", "a_y", "b_x", "b_y", "b_z"], {"b": (2, 3, 4)}),
        (["", ""], {}),
        ([], {}),
    ],
)
def test_channels_that_belong_together_are_told(labels: list[str], found: dict[str, tuple[int, int, int]]) -> None:
    assert triples(labels, "HAND") == found


def test_sensors_on_the_body_come_with_the_clock_carried_over(name: str) -> None:
    info = pylsl.StreamInfo(name, "Accelerometer", 4, 100, "float32", f"id-{name}")
    channels = info.desc().append_child("channels")
    for label in ("battery", "HAND_R_x", "HAND_R_y", "HAND_R_z"):
        channels.append_child("channel").append_child_value("label", label)
    outlet, samples = pylsl.StreamOutlet(info), []
    source = LslBody("inertial", name, "HAND")
    source.on_value = lambda sample: samples.append((time.monotonic_ns(), sample))
    source.start()
    try:

        def pushed() -> bool:
            outlet.push_sample([50.0, 1.0, 2.0, 9.0])
            return len(samples) > 5 and samples[-1][1].valid

        until(pushed)
    finally:
        source.stop(10.0)
    at_ns, sample = samples[-1]
    assert (sample.sensor, sample.x, sample.y, sample.z, sample.stamp) == ("HAND_R", 1, 2, 9, StampSource.HARDWARE)
    assert -MS < at_ns - sample.captured_ns < 1000 * MS


def test_a_stream_without_triples_is_one_line(name: str, tracker: Tracker) -> None:
    with pytest.raises(InputError, match="are no x, y, z of sensors"):
        LslBody("inertial", name, "HAND")
