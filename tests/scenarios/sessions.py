"""Small recorded sessions made by the tests themselves: the simulated wearer, packed and filmed."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import STEP_NS, D
from hilbridge.wearer.person import Wearer

SECONDS = 6
STEPS = SECONDS * 25
FPS = 24.0


def wearers_features(steps: int = STEPS) -> tuple[np.ndarray, np.ndarray]:
    """A session of the simulated wearer through the feature chain, as `hilbridge data pack` would keep it."""
    wearer, assembler = Wearer(3, width_px=96, height_px=72), FeatureAssembler()
    values, valid = np.zeros((steps, D), np.float32), np.zeros((steps, 3), bool)
    for step in range(steps):
        t_ns = step * STEP_NS
        vector = assembler.update(wearer.frame(t_ns), wearer.gaze(t_ns), wearer.hands(t_ns), t_ns)
        values[step], valid[step] = vector.values, vector.valid
    return values, valid


def film(made: Path) -> dict[str, object]:
    """Leave a video and its gaze in a folder; gives them as a scenario's `intent`."""
    wearer = Wearer(3, width_px=96, height_px=72)
    video = cv2.VideoWriter(str(made / "session.avi"), cv2.VideoWriter.fourcc(*"MJPG"), FPS, (96, 72))
    for number in range(round(SECONDS * FPS)):
        video.write(cv2.cvtColor(wearer.frame(round(number / FPS * 1e9)).rgb, cv2.COLOR_RGB2BGR))
    video.release()
    rows = [
        f"{k / 50},{wearer.gaze(k * 20_000_000).x:.5f},{wearer.gaze(k * 20_000_000).y:.5f}" for k in range(50 * SECONDS)
    ]
    (made / "gaze.csv").write_text("\n".join(["time_s,x,y", *rows]))
    return {"video": str(made / "session.avi"), "gaze": str(made / "gaze.csv")}
