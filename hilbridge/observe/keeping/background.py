"""A recording with a writing thread of its own, so that a slow disk never delays a tick. What is lost is counted."""

from __future__ import annotations

import struct
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.observe.parts import RecordingInParts, Rotation
from hilbridge.observe.recording import Adds, AddsNothing
from hilbridge.priority import Level, take_level
from hilbridge.rows import ImageRow, Row, SceneRow

# Half a minute of everything the bridge says. A disk that is slower than that loses rows, which are counted and shown.
_QUEUE_ROWS = 20_000
# Pictures are the largest and say least: they give way first.
_QUEUE_WITH_PICTURES = 2_000
_EVERY_S = 0.2


class BackgroundRecording:
    """Takes rows from any thread. They are written a few times a second, all that came meanwhile: to wake a thread for
    each row would cost more than to write it.
    """

    def __init__(self, path: Path, adds: Adds | None = None, rotation: Rotation | None = None) -> None:
        """Raises InputError where nothing can be written."""
        self._recording = RecordingInParts(path, adds or AddsNothing(), rotation or Rotation())
        self._rows: deque[Row] = deque()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._drain, name="recording", daemon=True)
        self._failure: Exception | None = None
        self._discarded = False
        self.on_failure: Callable[[str], None] = lambda why: None  # told once, in the writing thread
        self.lost_rows = 0
        self.lost_pictures = 0
        self._thread.start()

    @property
    def path(self) -> Path:
        """Of the first part."""
        return self._recording.path

    def write(self, row: Row) -> None:
        """Hand one row over; where the disk is too slow or has failed it is lost, and counted."""
        waiting = len(self._rows)
        if isinstance(row, ImageRow | SceneRow) and waiting >= _QUEUE_WITH_PICTURES:
            self.lost_pictures += 1
        elif self._failure is not None or waiting >= _QUEUE_ROWS:
            self.lost_rows += 1
        else:
            self._rows.append(row)

    def close(self) -> None:
        """Write what waits and close the file. Raises InputError with what the disk said."""
        self._ending.set()
        self._thread.join()
        if self._failure is not None:
            raise InputError(
                f"recording {self.path}: {self._failure}; {self.lost_rows} rows were lost, what was written before can "
                "be read; is the disk full?"
            )

    def discard(self) -> None:
        """Remove the file: what it belongs to never began."""
        self._discarded = True
        self._ending.set()
        self._thread.join()

    def _drain(self) -> None:
        ending = False
        while not ending:
            ending = self._ending.wait(_EVERY_S)  # what came before the end is written after it was asked for
            take_level(Level.RECORDING)  # each time: a run asks for real time after its recording has begun
            self._write_waiting()
        try:
            if self._discarded:
                self._recording.discard()
            else:
                self._recording.close()
        except (OSError, struct.error) as failure:
            self._failure = self._failure or failure

    def _write_waiting(self) -> None:
        while self._rows:
            row = self._rows.popleft()
            if self._failure is not None:
                self.lost_rows += 1
                continue
            try:
                self._recording.write(row)
            except (OSError, InputError, ValueError, TypeError, struct.error) as failure:
                self._failure = failure
                self.on_failure(str(failure))
