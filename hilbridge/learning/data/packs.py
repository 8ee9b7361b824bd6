"""`hilbridge data pack PATH`: every session's features, made once by the project's own chain and kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hilbridge.features.packs import file_hash, write_pack
from hilbridge.learning.data.egtea import DatasetError
from hilbridge.learning.data.sessions import PACKS, gaze_path, load_features, recorded_sessions, video_path
from hilbridge.sensors.hands import HandDetector
from hilbridge.sensors.models import hand_model_path


def _without_pack(root: Path) -> list[str]:
    return [name for name in recorded_sessions(root) if not (root / PACKS / f"{name}.npz").is_file()]


def missing(root: Path) -> int:
    """How many sessions have gaze or a video but no pack yet."""
    return len(_without_pack(root))


def make_packs(
    root: Path,
    with_hands: bool = True,
    progress: Callable[[], None] = lambda: None,
    say: Callable[[str], None] = lambda _: None,
) -> list[Path]:
    """Write the packs that are missing; an interrupted run goes on with the next session.

    Raises InputError (DatasetError, BegazeError) naming the file that is not what it should be, or for videos whose hands
    cannot be looked for here.
    """
    if not root.is_dir():
        raise DatasetError(f"{root}: no such folder; give the folder of the EGTEA Gaze+ package")
    if not recorded_sessions(root):
        raise DatasetError(f"{root}: neither gaze nor videos in it; give the folder of the EGTEA Gaze+ package")
    made = []
    for name in _without_pack(root):
        pack = root / PACKS / f"{name}.npz"
        detector = None
        if with_hands and video_path(root, name) is not None:
            detector = HandDetector(hand_model_path())
        try:
            values, valid = load_features(root, name, detector.detect if detector is not None else None)
        finally:
            if detector is not None:
                detector.close()
        sources = [
            path for path in (gaze_path(root, name), video_path(root, name)) if path is not None and path.is_file()
        ]
        write_pack(pack, values, valid, {path.name: file_hash(path) for path in sources})
        made.append(pack)
        say(
            f"{pack.name}: {len(values)} steps, valid gaze, hands, scene {', '.join(f'{s:.0%}' for s in valid.mean(axis=0))}"
        )
        progress()
    return made
