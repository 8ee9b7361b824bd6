"""The hand detector in a process of its own: what MediaPipe does there, it cannot do to the bridge.

A picture goes over in shared memory, its hands come back through a pipe. A detector that does not answer in time gives no
answer for that picture; one that is dead, hangs or grows too large is killed and started again, with growing pauses.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext
from multiprocessing.process import BaseProcess
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hilbridge.errors import InputError
from hilbridge.records import CameraFrame, Hand, HandTracks

ANSWER_S = 0.1  # later, the features of the picture go without hands; half of that would lose many on a busy machine
HUNG_S = 1.0
START_S = 60.0
LARGEST_BYTES = 1_500_000_000
_PAUSES_S = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
_QUIET_S = 30.0  # a detector that lived so long was well: the next pause is the first again
_LEAST_BYTES = 1280 * 720 * 3

Detects = Callable[[CameraFrame], HandTracks]
Makes = Callable[..., Any]


class Job(NamedTuple):
    """A picture that lies in shared memory."""

    memory: str
    captured_ns: int
    sequence: int
    shape: tuple[int, int]


class Answer(NamedTuple):
    """The hands of the picture with this number, and how much memory the detector holds."""

    sequence: int
    hands: tuple[Hand, ...]
    resident_bytes: int


class HandsApart:
    """Finds hands in another process. `detect` never waits longer than `ANSWER_S`; None is no answer.

    `make` builds the detector over there (a test gives its own). `alive` is False from the moment it is given up until another
    one is ready. `on_event` is told each change. Raises InputError when the first one cannot be started.
    """

    def __init__(self, make: Makes, *arguments: Any, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._make, self._arguments, self._clock_s = make, arguments, clock_s
        self.on_event: Callable[[str], None] = lambda text: None
        self.restarts = 0
        self._context: SpawnContext = multiprocessing.get_context("spawn")
        self._memory: SharedMemory | None = None
        self._closing = threading.Event()
        self._lock = threading.Lock()
        self._asked: tuple[int, float] | None = None  # the picture under way, and since when
        self._began_s = 0.0
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._starter: threading.Thread | None = None
        self._pauses = 0
        self._start()

    @property
    def alive(self) -> bool:
        return self._pipe is not None

    @property
    def pid(self) -> int | None:
        return None if self._process is None else self._process.pid

    def detect(self, frame: CameraFrame) -> HandTracks | None:
        """The hands of a picture, or None where there is no answer in time."""
        pipe = self._pipe
        if pipe is None:
            return None
        try:
            if self._asked is not None and not self._catch_up(pipe):
                return None
            pipe.send(self._hand_over(frame))
            self._asked = (frame.sequence, self._clock_s())
            if not pipe.poll(ANSWER_S):
                return None
            answer: Answer = pipe.recv()
            self._asked = None
        except (OSError, EOFError):
            self._give_up("has died")
            return None
        if answer.resident_bytes > LARGEST_BYTES:
            self._give_up(f"holds {answer.resident_bytes / 1e6:.0f} MB")
        return HandTracks(frame.captured_ns, answer.hands)

    def close(self) -> None:
        """End the process, free the memory."""
        self._closing.set()
        self._drop()
        if self._starter is not None:
            self._starter.join(2.0)
        self._drop()
        if self._memory is not None:
            self._memory.close()
            self._memory.unlink()
            self._memory = None

    def _catch_up(self, pipe: Connection) -> bool:
        """Whether the picture before is done with; one that takes too long is given up."""
        assert self._asked is not None
        if pipe.poll(0):
            pipe.recv()  # too late to be of use
            self._asked = None
            return True
        if self._clock_s() - self._asked[1] > HUNG_S:
            self._give_up(f"has not answered for {HUNG_S:g} s")
        return False

    def _hand_over(self, frame: CameraFrame) -> Job:
        rgb = frame.rgb
        if self._memory is None or self._memory.size < rgb.nbytes:
            if self._memory is not None:
                self._memory.close()
                self._memory.unlink()
            self._memory = SharedMemory(create=True, size=max(rgb.nbytes, _LEAST_BYTES))
        np.ndarray(rgb.shape, np.uint8, self._memory.buf)[:] = rgb
        return Job(self._memory.name, frame.captured_ns, frame.sequence, (rgb.shape[0], rgb.shape[1]))

    def _start(self) -> None:
        """A new process, ready. Raises InputError."""
        ours, theirs = self._context.Pipe()
        process = self._context.Process(
            target=work, args=(theirs, self._make, self._arguments), name="hands", daemon=True
        )
        process.start()
        theirs.close()
        try:
            said = ours.recv() if ours.poll(START_S) else f"hands: not ready within {START_S:g} s; is the machine busy?"
        except (OSError, EOFError):
            said = "hands: the detector died at its start; run `hilbridge doctor`"
        if said is not None:
            process.kill()
            ours.close()
            raise InputError(said)
        with self._lock:
            if self._closing.is_set():
                process.kill()
                ours.close()
                return
            self._process, self._began_s, self._asked, self._pipe = process, self._clock_s(), None, ours

    def _give_up(self, why: str) -> None:
        if self._clock_s() - self._began_s > _QUIET_S:
            self._pauses = 0
        self._drop()
        self.on_event(f"hands: the detector {why}; starting it again")
        if not self._closing.is_set():
            self._starter = threading.Thread(target=self._start_again, name="hands starter", daemon=True)
            self._starter.start()

    def _start_again(self) -> None:
        while True:
            pause_s = _PAUSES_S[min(self._pauses, len(_PAUSES_S) - 1)]
            self._pauses += 1
            if self._closing.wait(pause_s):
                return
            try:
                self._start()
            except InputError as error:
                self.on_event(str(error))
                continue
            self.restarts += 1
            self.on_event("hands: the detector is back")
            return

    def _drop(self) -> None:
        with self._lock:
            pipe, self._pipe = self._pipe, None
            process, self._process = self._process, None
        if pipe is not None:
            pipe.close()
        if process is not None:
            process.kill()  # also one that is stopped
            process.join(1.0)


def work(pipe: Connection, make: Makes, arguments: tuple[Any, ...]) -> None:
    """The other process: make the detector, say that it is ready, answer until the pipe is closed.

    It runs at the level of the thread that started it, as its own threads do.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the bridge's; the pipe's end is ours
    try:
        detector = make(*arguments)
    except InputError as error:
        pipe.send(str(error))
        return
    pipe.send(None)
    memory: SharedMemory | None = None
    with contextlib.suppress(OSError, EOFError):
        while True:
            job: Job = pipe.recv()
            if memory is None or memory.name != job.memory:
                memory = SharedMemory(job.memory)
            pixels = np.ndarray((*job.shape, 3), np.uint8, memory.buf)
            tracks = detector.detect(CameraFrame(job.captured_ns, pixels, job.sequence))
            del pixels
            pipe.send(Answer(job.sequence, tracks.hands, _resident_bytes()))


def _resident_bytes() -> int:
    """Of this process; 0 where the system does not say."""
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * 4096
    except (OSError, ValueError, IndexError):
        return 0
