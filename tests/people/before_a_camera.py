"""Simulated people as a camera and an eye tracker would have left them, and the way from their recordings to a bundle.

What is made here says that it is of recorded people, which is not so: it never leaves a test's own folder.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2

from hilbridge.features.layout import RATE_HZ, STEP_NS
from hilbridge.intent.bundle import Thresholds, demo_bundle_path, load_bundle, save_bundle
from hilbridge.intent.provenance import Origin, Promise, Provenance, digest_of
from hilbridge.learning.certificate.certify_bundle import CertifyConfig
from hilbridge.learning.training.recipes import Recipe
from hilbridge.observe.reading import read_recording
from hilbridge.observe.recording import AddsNothing, Recording
from hilbridge.people.adapt import adapt
from hilbridge.people.certify import certify_on_people
from hilbridge.people.simulate import simulate
from hilbridge.people.train import PeopleConfig, train_on_people
from hilbridge.rows import LabelRow, MetaRow
from hilbridge.wearer.person import Wearer
from hilbridge.wearer.timeline import DEMO

SECONDS = 24.0
TINY = Recipe(
    hidden=16, inner=8, epochs=2, windows_per_epoch=1_000, learning_rate=1e-2, averaging=0.5, class_weight_power=0.0
)
LEARNS = replace(TINY, hidden=32, inner=16, epochs=6, windows_per_epoch=4_000, jitter=0.3, averaging=0.8)


def of_camera(source: Path, target: Path, person: str, *, labels: bool = True) -> Path:
    """A simulated recording as a live run with a camera would have left it."""
    target.mkdir(parents=True)
    with Recording(target / "recording.mcap", AddsNothing()) as recording:
        for row in read_recording(source):
            if isinstance(row, MetaRow):
                row = replace(row, camera="0", gaze="neon:", participant=person)
            if labels or not isinstance(row, LabelRow):
                recording.write(row)
    return target


def bundle_of_one_wearer(root: Path, first_seed: int = 42_000) -> tuple[PeopleConfig, Path, Path]:
    """Twelve people to train on, eight others to certify on, one wearer: (training, the certified bundle, the wearer's)."""
    simulate(root / "made", 21, SECONDS, DEMO, first_seed, lambda: None)
    seeds = range(first_seed, first_seed + 21)
    train, others, one = (root / name for name in ("train", "others", "one"))
    for folder, part in ((train, seeds[:12]), (others, seeds[12:20]), (one, seeds[20:])):
        for seed in part:
            of_camera(root / "made" / f"S-{seed}" / "recording.mcap", folder / f"run-{seed}", f"P-{seed}")
    config = PeopleConfig((train,), root / "b", root / "work", root / "report", recipe=LEARNS, precision=0.2, folds=2)
    train_on_people(config)
    asked = CertifyConfig(config.out, precision=0.1, delta=0.3, write=root / "certified")
    certified = certify_on_people(asked, (others,), lambda line: None)
    assert certified.written is not None, certified.lines()
    adapt(certified.written, (one,), root / "mine")
    return config, certified.written, root / "mine"


def as_of_people(path: Path) -> Path:
    """The shipped bundle, saying what one of twelve recorded people would, at a threshold that it reaches without hands."""
    bundle = load_bundle(demo_bundle_path())
    who, data = tuple(digest_of(f"P-{place}") for place in range(12)), {"made up": "0" * 64}
    promise = Promise(0.3, 0.2, 0.3, "betting", "average person", 8, Origin.RECORDED, data)
    adapted = {"adapted_to_one_wearer": {"files": 1}}
    record = Provenance(Origin.RECORDED, 12, 12.0, {}, who, data, adapted, {}, promise)
    return save_bundle(replace(bundle, thresholds=Thresholds(0.3, 0.25), provenance=record), path)


def filmed(folder: Path, seed: int, seconds: float) -> tuple[Path, Path]:
    """What a camera and an eye tracker see of a simulated wearer, as a video and a table of gaze."""
    wearer = Wearer(seed, width_px=320, height_px=240)
    video, gaze = folder / "wearer.mp4", folder / "wearer.csv"
    out = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, (320, 240))
    lines = ["time_s,x,y,valid"]
    for step in range(round(seconds * RATE_HZ)):
        now_ns = step * STEP_NS
        out.write(cv2.cvtColor(wearer.frame(now_ns).rgb, cv2.COLOR_RGB2BGR))
        look = wearer.gaze(now_ns)
        lines.append(f"{now_ns / 1e9:.3f},{look.x:.5f},{look.y:.5f},{int(look.valid)}")
    out.release()
    gaze.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return video, gaze
