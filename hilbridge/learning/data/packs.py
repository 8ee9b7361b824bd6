"""`hilbridge data pack PATH`: every session's features, made once by the project's own chain and kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hilbridge.cluster import run_all, workers
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
    *,
    jobs: int = 1,
    cluster: str | None = None,
) -> list[Path]:
    """Write the packs that are missing; an interrupted run goes on with the next session.

    jobs, cluster: where (`hilbridge.cluster`); a cluster's workers must see the same folder. Raises InputError (DatasetError,
    BegazeError) naming the file that is not what it should be, or for videos whose hands cannot be looked for here.
    """
    if not root.is_dir():
        raise DatasetError(f"{root}: no such folder; give the folder of the EGTEA Gaze+ package")
    if not recorded_sessions(root):
        raise DatasetError(f"{root}: neither gaze nor videos in it; give the folder of the EGTEA Gaze+ package")

    def done(packed: tuple[Path, str]) -> None:
        say(packed[1])
        progress()

    parts = [(root.absolute(), name, with_hands) for name in _without_pack(root)]
    with workers(jobs, cluster) as pools:
        return [root / PACKS / pack.name for pack, _ in run_all(pools, _packed, parts, "data pack", done)]


def _packed(root: Path, name: str, with_hands: bool) -> tuple[Path, str]:
    """The pack of one session, and what is in it in words."""
    pack = root / PACKS / f"{name}.npz"
    detector = None
    if with_hands and video_path(root, name) is not None:
        detector = HandDetector(hand_model_path())
    try:
        values, valid = load_features(root, name, detector.detect if detector is not None else None)
    finally:
        if detector is not None:
            detector.close()
    sources = [path for path in (gaze_path(root, name), video_path(root, name)) if path is not None and path.is_file()]
    write_pack(pack, values, valid, {path.name: file_hash(path) for path in sources})
    shares = ", ".join(f"{share:.0%}" for share in valid.mean(axis=0))
    return pack, f"{pack.name}: {len(values)} steps, valid gaze, hands, scene {shares}"
