"""A recording in Rerun's viewer. Rerun is an extra and comes in here only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hilbridge.errors import needs_extra
from hilbridge.observe.reading import read_recording
from hilbridge.rows import (
    BeliefRow,
    DeviceRow,
    EventRow,
    FaultRow,
    GazeRow,
    HandsRow,
    ImageRow,
    LabelRow,
    Row,
    TickRow,
)

_ROWS = (TickRow, BeliefRow, DeviceRow, EventRow, FaultRow, LabelRow, ImageRow, GazeRow, HandsRow)


def show(places: Sequence[Path], save: Path | None) -> None:
    """Open the viewer, or write what it would show to `save`. Raises InputError without the extra, or on bad input."""
    with needs_extra("view"):
        import rerun

    reader = read_recording(places, [kind.topic for kind in _ROWS])
    rows = iter(reader)
    first = next(rows, None)  # before a viewer opens: what is no recording opens none
    rerun.init("hilbridge", spawn=save is None)
    if save is not None:
        rerun.save(str(save))
    teller = _Teller(rerun)
    if first is not None:
        teller.tell(first)
    for row in rows:
        teller.tell(row)
    if reader.missing is not None:
        rerun.log("event", rerun.TextLog(reader.missing, level="WARN"))


class _Teller:
    """Each row as what Rerun draws of it."""

    def __init__(self, rerun: Any) -> None:
        self._rerun = rerun
        self._size_px = (1, 1)
        self._tell: dict[type[Any], Callable[[Any], None]] = {
            TickRow: self._tick,
            BeliefRow: self._belief,
            DeviceRow: self._device,
            EventRow: lambda row: self._text(row.text),
            FaultRow: lambda row: self._text(f"{row.fault} {'begins' if row.begins else 'ends'}"),
            LabelRow: lambda row: self._text(f"label {row.verb} ({row.source})"),
            ImageRow: self._picture,
            GazeRow: self._gaze,
            HandsRow: self._hands,
        }

    def tell(self, row: Row) -> None:
        """Log one row at its time."""
        self._rerun.set_time("recording", duration=row.time_ns / 1e9)
        self._tell[type(row)](row)

    def _number(self, path: str, value: float | None) -> None:
        if value is not None:
            self._rerun.log(path, self._rerun.Scalars(float(value)))

    def _text(self, text: str) -> None:
        self._rerun.log("event", self._rerun.TextLog(text))

    def _tick(self, row: TickRow) -> None:
        for name in ("confidence", "tau_on", "tau_off"):
            self._number(f"confidence/{name}", getattr(row, name))
        self._number("gate/act", row.act)
        self._number("timing/latency_ms", row.latency_ms)
        self._number("timing/work_ms", row.work_ms)

    def _belief(self, row: BeliefRow) -> None:
        self._rerun.log("belief", self._rerun.BarChart(list(row.probabilities)))

    def _device(self, row: DeviceRow) -> None:
        for name in ("assist_nm", "gravity_nm", "follow_nm"):
            self._number(f"torque/{name}", getattr(row, name))
        self._number("device/angle_deg", row.angle_deg)
        self._rerun.log("device/state", self._rerun.TextLog(f"{row.state} {row.reason}"))

    def _picture(self, row: ImageRow) -> None:
        self._size_px = (row.width_px, row.height_px)
        self._rerun.log("camera", self._rerun.EncodedImage(contents=row.data, media_type="image/jpeg"))

    def _gaze(self, row: GazeRow) -> None:
        self._points("camera/gaze", [(row.x, row.y)] if row.valid else [])

    def _hands(self, row: HandsRow) -> None:
        self._points("camera/hands", [(hand.x, hand.y) for hand in row.hands])

    def _points(self, path: str, points: Sequence[tuple[float | None, float | None]]) -> None:
        width, height = self._size_px
        known = [(x * width, y * height) for x, y in points if x is not None and y is not None]
        self._rerun.log(path, self._rerun.Points2D(known, radii=6.0))
