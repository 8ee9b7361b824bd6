"""sensors.hands_apart: a detector that is killed, hangs, grows or cannot start is a dropout and is replaced."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from hilbridge.errors import InputError
from hilbridge.records import CameraFrame, Hand, HandTracks
from hilbridge.sensors import hands_apart
from hilbridge.sensors.hands import HandDetector, open_detector
from hilbridge.sensors.hands_apart import HandsApart

GROW = 250


class Mean:
    """Says one hand, at the mean of the picture's red; a red of GROW makes it hold memory."""

    def __init__(self) -> None:
        self.held: list[bytes] = []

    def detect(self, frame: CameraFrame) -> HandTracks:
        red = int(frame.pixels[0, 0, 0])
        if red == GROW:
            self.held.append(os.urandom(1) * 60_000_000)
        return HandTracks(frame.captured_ns, (Hand(float(frame.pixels[..., 0].mean()), 0.5, 0.9),))


def refuses() -> Mean:
    raise InputError("hand model: not there; fetch it")


def dies() -> Mean:
    os._exit(3)


def picture(red: int, sequence: int, size: tuple[int, int] = (72, 128)) -> CameraFrame:
    return CameraFrame(sequence * 40_000_000, np.full((*size, 3), red, np.uint8), sequence)


def until(condition: Callable[[], object]) -> None:
    end_s = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end_s, "it never came about"
        threading.Event().wait(0.01)


@pytest.fixture
def apart() -> Iterator[HandsApart]:
    one = HandsApart(Mean)
    yield one
    one.close()


@pytest.fixture
def events(apart: HandsApart) -> list[str]:
    said: list[str] = []
    apart.on_event = said.append
    return said


def answered(apart: HandsApart, red: int = 7) -> Callable[[], bool]:
    return lambda: apart.detect(picture(red, 1)) is not None


def test_the_hands_are_those_of_the_picture_also_when_pictures_grow(apart: HandsApart) -> None:
    until(answered(apart))
    for sequence, size in enumerate([(72, 128), (720, 1280), (1080, 1920), (72, 128)], 2):
        found: list[HandTracks | None] = []
        until(lambda size=size, n=sequence, found=found: found.append(apart.detect(picture(n, n, size))) or found[-1])
        assert found[-1] is not None
        assert found[-1].hands[0].x == sequence
        assert found[-1].captured_ns == sequence * 40_000_000


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
def test_one_that_is_killed_is_replaced(apart: HandsApart, events: list[str], number: int) -> None:
    until(answered(apart))
    first = apart.pid
    assert first is not None
    os.kill(first, number)
    until(lambda: apart.detect(picture(1, 2)) is None and not apart.alive)
    until(answered(apart))
    assert apart.pid != first
    assert events == ["hands: the detector has died; starting it again", "hands: the detector is back"]


def test_one_that_hangs_is_replaced_and_never_waited_for(apart: HandsApart, events: list[str]) -> None:
    until(answered(apart))
    first = apart.pid
    assert first is not None
    os.kill(first, signal.SIGSTOP)
    until(lambda: apart.detect(picture(1, 2)) is None and not apart.alive)
    until(answered(apart))
    assert apart.pid != first
    assert "has not answered" in events[0]


def test_an_answer_that_comes_late_is_not_taken_for_the_next_picture(apart: HandsApart) -> None:
    until(answered(apart))
    assert apart.pid is not None
    os.kill(apart.pid, signal.SIGSTOP)
    assert apart.detect(picture(11, 2)) is None
    os.kill(apart.pid, signal.SIGCONT)
    found: list[HandTracks] = []

    def look() -> bool:
        tracks = apart.detect(picture(22, 3))
        if tracks is not None:
            found.append(tracks)
        return bool(found)

    until(look)
    assert found[0].hands[0].x == 22
    assert apart.restarts == 0


def test_one_that_grows_is_replaced(apart: HandsApart, events: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    until(answered(apart))
    monkeypatch.setattr(hands_apart, "LARGEST_BYTES", 500_000_000)
    monkeypatch.setattr(hands_apart, "ANSWER_S", 30.0)  # memory may be slow to come by
    until(lambda: apart.detect(picture(GROW, 2)) is not None and bool(events))
    assert "MB; starting it again" in events[0]
    until(answered(apart))
    assert apart.restarts == 1


@pytest.mark.parametrize(("make", "said"), [(refuses, "fetch it"), (dies, "died at its start")])
def test_one_that_cannot_start_is_one_line(make: Callable[[], Mean], said: str) -> None:
    with pytest.raises(InputError, match=said):
        HandsApart(make)


def test_closing_ends_the_process_also_one_that_hangs() -> None:
    apart = HandsApart(Mean)
    until(answered(apart))
    pid = apart.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    apart.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert apart.detect(picture(1, 2)) is None


@pytest.mark.data
def test_photographs_have_the_same_hands_apart(hand_model: Path, data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hands_apart, "ANSWER_S", 30.0)
    for path in sorted((data / "hands").glob("*.jpg"))[::6]:
        pixels = np.ascontiguousarray(cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB))
        frame = CameraFrame(1_000_000_000, pixels, 1)
        apart = HandsApart(open_detector, hand_model, None)
        there = apart.detect(frame)
        apart.close()
        with HandDetector(hand_model) as detector:
            assert there == detector.detect(frame)
