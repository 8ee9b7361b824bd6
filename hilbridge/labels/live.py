"""Where marks of a running session come from: the terminal's keys, and Lab Streaming Layer markers."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from hilbridge.errors import InputError, needs_extra
from hilbridge.labels.marks import Marks
from hilbridge.rows import Row

_LSL_WAIT_S = 5.0
_LSL_PULL_S = 0.2


@dataclass(frozen=True, slots=True)
class MarkOptions:
    """keys: key -> verb. lsl: name of a marker stream whose samples are verbs, `stop`, or `end`."""

    keys: Mapping[str, str] = field(default_factory=dict)
    lsl: str | None = None


@contextlib.asynccontextmanager
async def marking(
    options: MarkOptions, record: Callable[[Row], None], notice: Callable[[str], None]
) -> AsyncIterator[None]:
    """Write a label for every span that is marked inside. Raises InputError."""
    with contextlib.ExitStack() as stack:
        if options.keys:
            marks = Marks("key")
            take = _taking(marks, record, notice)
            stack.callback(_finish, marks, record)
            stack.enter_context(_terminal_keys(lambda key: take(options.keys[key], time.monotonic_ns()), options.keys))
        if options.lsl is not None:
            streamed = Marks(f"lsl:{options.lsl}")
            stack.callback(_finish, streamed, record)
            stream = await asyncio.to_thread(_connected, options.lsl)  # seconds: the loop has a bus to read
            stack.enter_context(_lsl_markers(stream, _taking(streamed, record, notice)))
        yield


def _taking(marks: Marks, record: Callable[[Row], None], notice: Callable[[str], None]) -> Callable[[str, int], None]:
    def take(text: str, at_ns: int) -> None:
        try:
            ended = marks.mark(text, at_ns)
        except InputError as error:
            notice(f"mark left out: {error}")
            return
        if ended is not None:
            record(ended)
        notice(f"marked: {marks.verb or 'nothing'} since now")

    return take


def _finish(marks: Marks, record: Callable[[Row], None]) -> None:
    ended = marks.finish(time.monotonic_ns())
    if ended is not None:
        record(ended)


@contextlib.contextmanager
def _terminal_keys(on_key: Callable[[str], None], keys: Mapping[str, str]) -> Iterator[None]:
    """Keys of the terminal while this process is in its foreground. Raises InputError where there is no terminal."""
    if not sys.stdin.isatty():
        raise InputError("--mark: standard input is no terminal, so no key can be pressed; use --mark-lsl")
    import termios
    import tty

    descriptor = sys.stdin.fileno()
    if os.tcgetpgrp(descriptor) != os.getpgrp():
        raise InputError("--mark: this run is in the background of its terminal; start it in the foreground")
    loop, before = asyncio.get_running_loop(), termios.tcgetattr(descriptor)

    def ready() -> None:
        for key in os.read(descriptor, 64).decode("utf-8", "ignore"):
            if key in keys:
                on_key(key)

    tty.setcbreak(descriptor, termios.TCSANOW)
    loop.add_reader(descriptor, ready)
    try:
        yield
    finally:
        loop.remove_reader(descriptor)
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


class _Stream(NamedTuple):
    """An LSL inlet, its first time correction, how far this computer's LSL clock is from the monotonic one, its errors."""

    inlet: Any
    correction_s: float
    monotonic_minus_lsl_s: float
    lost: tuple[type[Exception], ...]


def _connected(name: str) -> _Stream:
    """The marker stream of that name. Waits for it. Raises InputError."""
    with needs_extra("lsl"):
        import pylsl
        from pylsl.util import LostError
        from pylsl.util import TimeoutError as LslTimeoutError
    found = pylsl.resolve_byprop("name", name, 1, _LSL_WAIT_S)
    if not found:
        raise InputError(f"--mark-lsl {name}: no such stream within {_LSL_WAIT_S:g} s; is its program running?")
    inlet: Any = pylsl.StreamInlet(found[0], recover=True)
    try:
        inlet.open_stream(_LSL_WAIT_S)
        correction_s = inlet.time_correction(_LSL_WAIT_S)  # takes a moment the first time, is known at once later
    except (LostError, LslTimeoutError):
        raise InputError(f"--mark-lsl {name}: the stream does not answer; is a firewall in its way?") from None
    return _Stream(inlet, correction_s, time.monotonic() - pylsl.local_clock(), (LostError, LslTimeoutError))


@contextlib.contextmanager
def _lsl_markers(stream: _Stream, take: Callable[[str, int], None]) -> Iterator[None]:
    """Samples of a marker stream, at the monotonic time at which they were sent."""
    inlet, lost = stream.inlet, stream.lost
    loop, ended = asyncio.get_running_loop(), threading.Event()

    def pull() -> None:
        correction_s = stream.correction_s
        while not ended.is_set():
            try:
                sample, stamp_s = inlet.pull_sample(_LSL_PULL_S)
            except lost:
                ended.wait(_LSL_PULL_S)
                continue
            if sample:
                with contextlib.suppress(*lost):  # the last known one serves meanwhile
                    correction_s = inlet.time_correction(_LSL_PULL_S)
                at_ns = round((stamp_s + correction_s + stream.monotonic_minus_lsl_s) * 1e9)
                with contextlib.suppress(RuntimeError):  # the loop is closed
                    loop.call_soon_threadsafe(take, str(sample[0]), at_ns)

    thread = threading.Thread(target=pull, name="lsl markers", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(2 * _LSL_PULL_S + 1.0)
        inlet.close_stream()
