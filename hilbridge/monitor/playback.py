"""A recording as the page shows it: the view of any moment, made of the thirty seconds before it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.reader import make_reader

from hilbridge.errors import InputError
from hilbridge.monitor.card import card_of_row
from hilbridge.monitor.state import WINDOW_NS, Watch
from hilbridge.observe.keeping.sharing import SharedPicture, picture_of_rows
from hilbridge.observe.parts import recordings_in
from hilbridge.observe.reading import read_recording
from hilbridge.records import Frame
from hilbridge.rows import (
    BeliefRow,
    BundleRow,
    CanRow,
    Direction,
    EventRow,
    GazeRow,
    HandsRow,
    ImageRow,
    MetaRow,
    Row,
    TickRow,
    decode,
)
from hilbridge.verbs import VERBS
from hilbridge.wire.codec import Codec

_WENT_OUT = (None, "sent", "queued")
_FIRST = (MetaRow.topic, BundleRow.topic, EventRow.topic)
_MOVING = (CanRow.topic, TickRow.topic, BeliefRow.topic)
_SEEN = (ImageRow.topic, GazeRow.topic, HandsRow.topic)
_LOOK_BACK_NS = 1_000_000_000  # a picture stands until the next; older than that it is none


class Playback:
    """One recording, whole or in parts. Raises InputError for what is none, or has no index to find moments by."""

    def __init__(self, path: Path) -> None:
        self._parts = recordings_in([path])
        self._codec = Codec()
        self.begin_ns, self.end_ns = self._span()
        self.events: list[tuple[int, str]] = []
        self.card: list[tuple[str, str]] = []
        self.title, self.verbs = path.name, VERBS
        for row in read_recording(path, _FIRST):
            match row:
                case EventRow():
                    self.events.append((row.time_ns, row.text))
                case BundleRow():
                    self.card = card_of_row(row)
                    self.verbs = row.verbs
                case MetaRow(title=str() as title):
                    self.title = title

    @property
    def length_s(self) -> float:
        """From the first row to the last."""
        return (self.end_ns - self.begin_ns) / 1e9

    def view(self, at_s: float) -> dict[str, Any]:
        """What the page would have shown then, and what the bridge itself said."""
        until_ns = self.begin_ns + round(min(max(at_s, 0.0), self.length_s) * 1e9)
        watch = Watch(self._codec, self.begin_ns)
        watch.verbs = self.verbs
        for row in self._rows(_MOVING, until_ns - WINDOW_NS, until_ns):
            match row:
                case CanRow() if row.direction is Direction.RX or row.result in _WENT_OUT:
                    watch.take(_frame(row), row.time_ns)
                    watch.advance(row.time_ns)
                case TickRow():
                    watch.take_tick(row)
                case BeliefRow():
                    watch.take_belief(row)
        for at_ns, text in self.events:
            if until_ns - WINDOW_NS <= at_ns <= until_ns:
                watch.tell(text, at_ns)
        return watch.view(until_ns)

    def picture(self, at_s: float) -> SharedPicture | None:
        """What the camera, the eye tracker and the detector of hands saw newest then; None where there is no picture."""
        until_ns = self.begin_ns + round(min(max(at_s, 0.0), self.length_s) * 1e9)
        image, gaze, hands = None, None, None
        for row in self._rows(_SEEN, until_ns - _LOOK_BACK_NS, until_ns):
            match row:
                case ImageRow():
                    image = row
                case GazeRow():
                    gaze = row
                case HandsRow():
                    hands = row
        return None if image is None else picture_of_rows(image, gaze, hands)

    def _rows(self, topics: tuple[str, ...], since_ns: int, until_ns: int) -> list[Row]:
        rows: list[Row] = []
        for part in self._parts:
            with part.open("rb") as file:
                found = make_reader(file).iter_messages(
                    topics, starting_at=max(0, since_ns), ending_at=max(0, until_ns)
                )
                rows += [decode(channel.topic, message.log_time, message.data) for _, channel, message in found]
        return sorted(rows, key=lambda row: row.time_ns)

    def _span(self) -> tuple[int, int]:
        begins, ends = [], []
        for part in self._parts:
            try:
                with part.open("rb") as file:
                    summary = make_reader(file).get_summary()
            except (OSError, McapError, ValueError, EOFError):
                summary = None
            if summary is None or summary.statistics is None or not summary.statistics.message_count:
                raise InputError(
                    f"recording {part}: was cut off or is none; make it whole with `hilbridge recover {part}`"
                )
            begins.append(summary.statistics.message_start_time)
            ends.append(summary.statistics.message_end_time)
        return min(begins), max(ends)


def _frame(row: CanRow) -> Frame:
    return Frame(row.can_id, row.data, row.time_ns, 0, row.is_error, row.is_fd, row.is_extended, 0, row.is_remote)
