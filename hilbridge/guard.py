"""The one way out of a command: whatever goes wrong is one line for a person and an exit code, never a traceback.

What a person can mend (an InputError, wrong options, the system's refusal to read or write) ends with 2. What nobody
foresaw is a defect: its trace goes into a file that the line names, and the exit code is 1. Ctrl-C ends with 130.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import signal
import sys
import tempfile
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

import typer
from rich.console import Console

from hilbridge.errors import InputError

INTERRUPTED = 130  # the exit code of a program that Ctrl-C ended
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_CURES = {
    errno.EACCES: "name a place that may be used, or change its mode",
    errno.EPERM: "name a place that may be used, or change its owner",
    errno.EROFS: "name a folder that can be written",
    errno.ENOENT: "check the name",
    errno.EISDIR: "name a file, not a folder",
    errno.ENOTDIR: "a file stands where a folder is needed; name another place",
    errno.EEXIST: "name another place",
    errno.ENAMETOOLONG: "use a shorter name",
    errno.EMFILE: "raise `ulimit -n`",
    errno.ELOOP: "the link points to itself",
    errno.EIO: "check the disk",
    errno.ENXIO: "check that the device is there",
    errno.ETXTBSY: "name another file",
} | dict.fromkeys(_FULL, "free some space, or name a folder on another disk")


class Printer(Console):
    """A console whose closed output is an error like any other, so that what was saved can still be said."""

    def on_broken_pipe(self) -> None:
        """Called by rich while it handles the error."""
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))


def run_guarded(app: typer.Typer, name: str) -> NoReturn:
    """Run a command line to its end and leave with its exit code."""
    sys.exit(guarded(lambda: app(standalone_mode=False, prog_name=name), name))


def guarded(command: Callable[[], object], name: str) -> int:
    """The exit code of `command`; what went wrong has been said in one line."""
    _be_brief(name)
    try:
        try:
            _hear_interrupts()
            returned = command()
        finally:
            _flush()
    except BaseException as error:
        with _no_interrupts():  # Ctrl-C in the middle of this must not show a trace after all
            return _told(error, name)
    code = returned if isinstance(returned, int) else 0
    if code == INTERRUPTED:
        _say(name, "interrupted")
    return code


def _hear_interrupts() -> None:
    """From here on Ctrl-C is an exception: until here it ended the program (`hilbridge.entry`)."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        with contextlib.suppress(ValueError):  # not the main thread
            signal.signal(signal.SIGINT, signal.default_int_handler)


@contextlib.contextmanager
def _no_interrupts() -> Iterator[None]:
    """Ignore Ctrl-C inside. What stood before comes back: processes started later would inherit the ignoring."""
    try:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:  # not the main thread, where signals do not arrive
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_DFL if before is None else before)


@contextlib.contextmanager
def sure_to_end(name: str, patience_s: float = 5.0) -> Iterator[None]:
    """For work of a library that may lose a Ctrl-C, or wait for ever after it: what goes on for longer than `patience_s`
    after one is ended. What has been written stays; children are to hold a lease (`hilbridge.lease`).
    """
    if threading.current_thread() is not threading.main_thread():  # where signals do not arrive
        yield
        return
    timers: list[threading.Timer] = []

    def give_up() -> None:
        _say(name, "interrupted")
        os._exit(INTERRUPTED)

    def interrupted(number: int, frame: object) -> None:
        if not timers:
            timers.append(threading.Timer(patience_s, give_up))
            timers[0].daemon = True
            timers[0].start()
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, interrupted)
    try:
        yield
        for timer in timers:
            timer.cancel()
    finally:  # after an interrupt the patience holds to the program's end: libraries wait for their children there, too
        signal.signal(signal.SIGINT, signal.SIG_DFL if before is None else before)


def _told(error: BaseException, name: str) -> int:
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    if isinstance(error, SystemExit) and isinstance(error.__context__, BrokenPipeError):
        error = error.__context__  # typer leaves without a word
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else int(error.code is not None)
    if isinstance(error, KeyboardInterrupt | typer.Abort):
        _say(name, "interrupted")
        return INTERRUPTED
    text, code = _in_words(error)
    if text:
        _say(name, "; ".join([text.rstrip(".").replace(".;", ";"), *getattr(error, "__notes__", [])]))
    return code


def _in_words(error: BaseException) -> tuple[str, int]:
    if isinstance(error, InputError):
        return str(error), 2
    asks = getattr(error, "format_message", None)
    if asks is not None:  # wrong options: typer has a copy of click of its own, whose classes have no public name
        context = getattr(error, "ctx", None)
        where = context.command_path if context is not None else ""
        if not asks():  # nothing was asked for: its help has been shown
            return "", 2
        return f"{asks()}; `{where} --help` lists what there is" if where else str(asks()), 2
    if isinstance(error, BrokenPipeError):
        return "standard output was closed before all was said", 1
    if isinstance(error, OSError) and error.errno in _CURES:
        what = error.filename if error.filename is not None else "output"
        return f"{os.fsdecode(what) if isinstance(what, bytes) else what}: {error.strerror}; {_CURES[error.errno]}", 2
    if isinstance(error, MemoryError):
        return "not enough memory; close other programs, or give less at once", 2
    return _defect(error), 1


def _defect(error: BaseException) -> str:
    """Keep the trace for whoever mends it; say where it is."""
    try:
        descriptor, log = tempfile.mkstemp(prefix="hilbridge-", suffix=".log")
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write("".join(traceback.format_exception(error)))
        kept = f"the trace is in {log}"
    except OSError as unwritten:
        kept = f"the trace could not be kept ({unwritten.strerror})"
    frames = traceback.extract_tb(error.__traceback__)[-1:]
    place = f" at {Path(frames[0].filename).name}:{frames[0].lineno}" if frames else ""
    return f"defect: {type(error).__name__}: {error}{place}; please report it, {kept}"


def _say(name: str, text: str) -> None:
    line = " ".join(f"{name}: {text}".split())
    with contextlib.suppress(OSError, ValueError, AttributeError):  # nobody is there to read it
        sys.stderr.write(line.encode("utf-8", "backslashreplace").decode() + "\n")
        sys.stderr.flush()


def _flush() -> None:
    """Find out now whether what was printed has arrived; later Python would say so in two lines of its own."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError:
        with contextlib.suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise


def _be_brief(name: str) -> None:
    """Libraries log and warn, and threads fail, in lines and traces of their own: those are for developers."""
    logging.getLogger().addHandler(logging.NullHandler())
    if not sys.warnoptions:
        warnings.simplefilter("ignore")

    def thread_failed(args: threading.ExceptHookArgs) -> None:
        if args.exc_value is not None and not isinstance(args.exc_value, SystemExit):
            _say(name, _in_words(args.exc_value)[0])

    threading.excepthook = thread_failed
    sys.unraisablehook = lambda unraisable: None
