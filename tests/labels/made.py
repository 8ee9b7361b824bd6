"""A small recording with pictures, decisions and nothing else."""

from pathlib import Path

import numpy as np

from hilbridge.observe.keeping.pictures import PictureFormat, image_row
from hilbridge.observe.recording import Recording
from hilbridge.records import Action, CameraFrame, HoldReason
from hilbridge.rows import MetaRow, TickRow

BEGIN_NS = 5_000_000_000
FIRST_PICTURE_MS = 400


def recording(path: Path, seconds: float = 6.0, participant: str | None = None, pictures: bool = True) -> Path:
    with Recording(path) as out:
        out.write(MetaRow(BEGIN_NS, title="made", participant=participant))
        for step in range(round(seconds * 25)):
            now_ns = BEGIN_NS + step * 40_000_000
            out.write(TickRow(now_ns, Action.HOLD, HoldReason.CONFIDENCE, 0.5 + 0.4 * np.sin(step / 20)))
            if pictures and step >= 10:
                shade = np.full((24, 32, 3), min(255, step), np.uint8)
                out.write(image_row(CameraFrame(now_ns, shade, step), PictureFormat(), now_ns))
    return path
