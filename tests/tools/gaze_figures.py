"""The gaze filter on a real Neon recording: how much it trembles while the eye rests, and how soon it is there after a saccade.

`HILBRIDGE_TEST_DATA=... python -m tests.tools.gaze_figures`. Fixations of 250 ms and more are those that the recording itself
names; their first 100 ms are left out of jitter. Pixels are of a picture 1280 wide.

- jitter: root mean square distance from one output to the next, stepped with every sample (200 Hz), as the precision of eye
  trackers is given; median over fixations
- scatter: standard deviation from a straight line through each fixation, stepped as live, 25 times a second with the newest
  sample, at eight phases: the eye's and the head's own slow movement is mostly out of it
- settling: live; from the end of the saccade until the filter is within 1.5 degrees (19 px) of the median gaze of the
  first 100 ms
"""

from __future__ import annotations

import ast
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.features.gaze import REFERENCE_PX, GazeFilter
from hilbridge.limits import MS, TICK_NS
from hilbridge.records import GazeSample
from hilbridge.sensors.gaze import GazeRecording, open_gaze

_NEAR_PX = 19.0
_LEAST_NS = 250 * MS
_SETTLED_NS = 100 * MS
_PHASES = 8


@dataclass(frozen=True)
class Figures:
    """In pixels and milliseconds. raw_px: the jitter that the tracker gave."""

    fixations: int
    raw_px: float
    jitter_px: float
    scatter_px: float
    settle_p50_ms: float
    settle_p90_ms: float


def fixations(folder: Path, recording: GazeRecording) -> list[tuple[int, int]]:
    """Begin and end of each fixation of 250 ms and more that the recording names, on the recording's clock."""
    kind = np.dtype(ast.literal_eval((folder / "fixations.dtype").read_text()))
    rows = np.fromfile(folder / "fixations ps1.raw", kind)
    origin_ns = _origin_ns(folder, recording)
    found = []
    for row in rows[rows["event_type"] == 1]:
        begin_ns, end_ns = int(row["start_timestamp_ns"]) - origin_ns, int(row["end_timestamp_ns"]) - origin_ns
        if end_ns - begin_ns >= _LEAST_NS:
            found.append((begin_ns, end_ns))
    return found


def _origin_ns(folder: Path, recording: GazeRecording) -> int:
    first_ns = int(np.fromfile(folder / "gaze_200hz.time", "<i8")[0])
    return first_ns - int(recording.time_ns[0])


def stepped(recording: GazeRecording, every_ns: int, phase_ns: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """What the filter says at each step: times, and (N, 2) pixels, nan where it says nothing."""
    gaze = GazeFilter()
    times = np.arange(int(recording.time_ns[0]) + phase_ns, int(recording.time_ns[-1]), every_ns)
    newest = np.searchsorted(recording.time_ns, times, side="right") - 1
    out = np.full((len(times), 2), np.nan)
    for step, row in enumerate(newest.tolist()):
        at_ns, x, y = int(recording.time_ns[row]), float(recording.x[row]), float(recording.y[row])
        state = gaze.update(GazeSample(at_ns, x, y, bool(recording.valid[row])), int(times[step]))
        if state is not None:
            out[step] = state.x * REFERENCE_PX, state.y * REFERENCE_PX
    return times, out


def figures(folder: Path) -> Figures:
    """Of one recording."""
    recording = open_gaze(folder)
    spans = fixations(folder, recording)
    raw = np.column_stack([recording.x, recording.y]) * REFERENCE_PX
    raw[~recording.valid] = np.nan
    every = stepped(recording, 5 * MS, 0)
    scatter, settle = [], []
    for phase in range(_PHASES):
        times, out = stepped(recording, TICK_NS, phase * TICK_NS // _PHASES)
        for begin_ns, end_ns in spans:
            scatter.append(_from_line(*_rest(times, out, begin_ns, end_ns)))
            settle.append(_settled_ms(times, out, _place(recording.time_ns, raw, begin_ns), begin_ns, end_ns))
    known = [one for one in settle if one is not None]
    return Figures(
        len(spans),
        float(np.median([_step_px(_rest(recording.time_ns, raw, *span)[1]) for span in spans])),
        float(np.median([_step_px(_rest(*every, *span)[1]) for span in spans])),
        float(np.median([one for one in scatter if one is not None])),
        float(np.percentile(known, 50)),
        float(np.percentile(known, 90)),
    )


def _rest(
    times: NDArray[np.int64], places: NDArray[np.float64], begin_ns: int, end_ns: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """What is of a fixation after its first 100 ms."""
    inside = (times >= begin_ns + _SETTLED_NS) & (times <= end_ns) & np.isfinite(places[:, 0])
    return times[inside], places[inside]


def _step_px(places: NDArray[np.float64]) -> float:
    return float(np.sqrt((np.diff(places, axis=0) ** 2).sum(axis=1).mean()))


def _from_line(times: NDArray[np.int64], places: NDArray[np.float64]) -> float | None:
    """Of either axis; None where there are too few to tell."""
    if len(times) < 4:
        return None
    seconds = (times - times[0]) * 1e-9
    columns = np.column_stack([np.ones(len(times)), seconds])
    fitted, *_ = np.linalg.lstsq(columns, places, rcond=None)
    left = places - columns @ fitted
    return float(np.sqrt((left**2).sum() / (2 * (len(times) - 2))))


def _place(times: NDArray[np.int64], raw: NDArray[np.float64], begin_ns: int) -> NDArray[np.float64]:
    inside = (times >= begin_ns) & (times < begin_ns + _SETTLED_NS)
    return np.asarray(np.nanmedian(raw[inside], axis=0))


def _settled_ms(
    times: NDArray[np.int64], out: NDArray[np.float64], place: NDArray[np.float64], begin_ns: int, end_ns: int
) -> float | None:
    inside = np.flatnonzero((times >= begin_ns) & (times <= end_ns))
    near = inside[np.linalg.norm(out[inside] - place, axis=1) <= _NEAR_PX]
    return float(times[near[0]] - begin_ns) / MS if len(near) else None


def main() -> int:
    """Print the figures; exit code 1 where they are not what they have to be."""
    folder = Path(os.environ.get("HILBRIDGE_TEST_DATA", "")) / "neon" / "demo_recording"
    if not folder.is_dir():
        print("HILBRIDGE_TEST_DATA names no folder with neon/demo_recording")
        return 2
    found = figures(folder)
    print(
        f"{found.fixations} fixations: jitter {found.jitter_px:.2f} px (raw {found.raw_px:.2f}), live scatter "
        f"{found.scatter_px:.2f} px, settled after {found.settle_p50_ms:.0f} ms (p90 {found.settle_p90_ms:.0f})"
    )
    return int(found.jitter_px > 3.5 or found.settle_p50_ms > 60.0)


if __name__ == "__main__":
    sys.exit(main())
