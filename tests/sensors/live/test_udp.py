"""sensors.live.udp over real sockets: samples, a sender's clock, senders that are silent, wrong or two."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.records import BodySample, GazeSample, StampSource
from hilbridge.sensors.live.udp import UdpBody, UdpGaze
from hilbridge.sensors.source import SourceState
from tests.sensors.live.test_neon import until


class Sender:
    """Sends 100 samples a second; with a clock it stamps them and answers probes by it."""

    def __init__(self, port: int, *, skew_ns: int | None = None) -> None:
        self.skew_ns = skew_ns
        self.sample: dict[str, Any] = {"x": 0.25, "y": 0.5}
        self.sending = True
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.settimeout(0.01)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def send(self, thing: object) -> None:
        self.socket.send(thing if isinstance(thing, bytes) else json.dumps(thing).encode() + b"\n")

    def now_ns(self) -> int:
        return time.monotonic_ns() + (self.skew_ns or 0)

    def _run(self) -> None:
        while not self._closing.is_set():
            stamp = {} if self.skew_ns is None else {"t_ns": self.now_ns()}
            try:
                if self.sending:
                    self.send({**self.sample, **stamp})
                probe = json.loads(self.socket.recv(1000))
                self.send({**probe, "t_ns": self.now_ns()})
            except OSError:
                continue

    def close(self) -> None:
        self._closing.set()
        self._thread.join()
        self.socket.close()


class Heard:
    def __init__(self) -> None:
        self.samples: list[tuple[int, GazeSample]] = []
        self.events: list[str] = []
        self.source = UdpGaze(0, latency_ns=5 * MS)
        self.source.on_value = lambda sample: self.samples.append((time.monotonic_ns(), sample))
        self.source.on_event = self.events.append
        self.source.start()

    @property
    def runs(self) -> bool:
        return bool(self.samples) and self.source.state is SourceState.RUNNING


@pytest.fixture
def heard() -> Iterator[Heard]:
    one = Heard()
    yield one
    one.source.stop(10.0)


def test_samples_without_a_stamp_are_stamped_on_arrival_less_the_latency(heard: Heard) -> None:
    sender = Sender(heard.source.port)
    until(lambda: len(heard.samples) > 5)
    sender.close()
    at_ns, sample = heard.samples[-1]
    assert (sample.x, sample.y, sample.valid, sample.stamp) == (0.25, 0.5, True, StampSource.ARRIVAL)
    assert at_ns - sample.captured_ns >= 5 * MS


def test_a_sender_with_a_clock_is_carried_to_this_one(heard: Heard) -> None:
    sender = Sender(heard.source.port, skew_ns=10**18)
    until(lambda: heard.runs and len(heard.samples) > 20)
    sender.skew_ns = 2 * 10**18
    until(lambda: any("was set by" in text for text in heard.events))
    count = len(heard.samples)
    until(lambda: heard.runs and len(heard.samples) > count + 20)
    sender.close()
    good = [(at_ns, sample) for at_ns, sample in heard.samples if sample.valid]
    assert {sample.stamp for _, sample in good} == {StampSource.HARDWARE}
    assert all(at_ns - sample.captured_ns > -MS for at_ns, sample in good)


def test_a_sender_that_falls_silent_is_gone_and_comes_back(heard: Heard) -> None:
    sender = Sender(heard.source.port)
    until(lambda: heard.runs)
    sender.sending = False
    until(lambda: heard.source.state is SourceState.GONE)
    sender.sending = True
    until(lambda: heard.runs)
    sender.close()
    assert [text.rpartition(": ")[2] for text in heard.events] == ["gaze comes", "nothing comes", "gaze comes"]


def test_a_second_sender_is_not_listened_to_while_the_first_sends(heard: Heard) -> None:
    first = Sender(heard.source.port)
    until(lambda: heard.runs)
    second = Sender(heard.source.port)
    second.sample = {"x": 0.9, "y": 0.9}
    until(lambda: heard.source.cell.counts().failed > 5)
    assert {sample.x for _, sample in heard.samples} == {0.25}
    first.close()
    until(lambda: heard.samples[-1][1].x == 0.9)
    second.close()


@pytest.mark.parametrize(
    "line",
    [b"", b"no json\n", b"[]\n", b"{}\n", b'{"x": "a", "y": 1}\n', b'{"x": 1e999, "y": null}\n', b"\xff\n", b"7\n"],
)
def test_a_line_that_is_no_sample_is_counted_and_the_next_is_taken(heard: Heard, line: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", heard.source.port))
        sender.send(line + b'{"x": 0.5, "y": 0.5, "valid": false}\n{"x": NaN, "y": 0.5}\n')
        until(lambda: len(heard.samples) == 2)
    assert [sample.valid for _, sample in heard.samples] == [False, False]
    assert heard.source.cell.counts().failed == bool(line)


def test_a_port_that_is_taken_is_one_line(heard: Heard) -> None:
    with pytest.raises(InputError, match="name a port that is free"):
        UdpGaze(heard.source.port)


def test_sensors_on_the_body_come_with_their_names() -> None:
    samples: list[BodySample] = []
    source = UdpBody("inertial", 0, "127.0.0.1", "HAND")
    source.on_value = samples.append
    source.start()
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.connect(("127.0.0.1", source.port))
            sender.send(
                b'{"x": 1, "y": 2, "z": 9.8}\n{"sensor": "HAND_L", "x": NaN, "y": 0, "z": 0}\n{"x": 1, "y": 2}\n'
            )
            sender.send(b'{"sensor": 7, "x": 1, "y": 2, "z": 3}\n')
            until(lambda: source.cell.counts().failed == 2)
    finally:
        source.stop(10.0)
    assert [(one.sensor, one.x, one.valid) for one in samples] == [("HAND", 1.0, True), ("HAND_L", 0.0, False)]
