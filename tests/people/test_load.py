"""Every kind of folder becomes sessions of people by the same rules."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from hilbridge.errors import InputError
from hilbridge.features.layout import D
from hilbridge.features.packs import write_pack
from hilbridge.intent.provenance import Origin
from hilbridge.people.load import load_people, sessions_of
from hilbridge.verbs import VERBS
from tests.learning.package import ROW, package
from tests.sensors.begaze_lines import HEADER, OLD

LABELS = "start_ms,end_ms,verb,source\n1000,3000,Cut,me\n3000,5000,none,me\n5000,7000,Pour,me\n"
CUT, POUR = VERBS.index("Cut"), VERBS.index("Pour")


def silent(line: str) -> None: ...


def gaze_file(root: Path, session: str, x_px: int) -> None:
    (root / "gaze_data").mkdir(exist_ok=True)
    rows = [f"{n}\tSMP\t1\t{x_px + n % 7}\t480\t{n * 24 // 30}\t\t-" for n in range(300)]
    (root / "gaze_data" / f"{session}.txt").write_text("\n".join([*HEADER, OLD, *rows]))


def test_an_egtea_folder_gives_its_sessions_and_says_what_is_odd(tmp_path: Path) -> None:
    lines = [
        ROW.format(n=n, s=subject, start=start, end=start + 900, verb="Cut")
        for subject in (1, 2, 3)
        for n, start in enumerate((1000, 5000, 60_000))
    ]
    root = package(tmp_path, "".join(lines))
    for subject, x_px in ((1, 640), (2, 640), (3, 5_000)):
        gaze_file(root, f"P0{subject}-R01-Soup", x_px)
    gaze_file(root, "P09-R01-Soup", 640)
    said: list[str] = []
    people = load_people((root,), said.append)
    assert people.names == ("P01", "P02", "P03")
    assert people.origin is Origin.RECORDED
    assert any(line.startswith("P03-R01-Soup: 100% of its valid gaze is outside") for line in said)
    assert any("P09-R01-Soup: no annotations" in line for line in said)
    assert any("ends before 1 of 3 annotated actions" in line for line in said)
    first = people.sessions[0].stream
    assert first.right(np.full(len(first), CUT))[25:47].all()
    assert not first.right(np.full(len(first), CUT))[60]
    assert first.known[60]


def packs(folder: Path, names: tuple[str, ...], labels: str = LABELS) -> Path:
    for name in names:
        values = np.zeros((200, D), np.float32)
        write_pack(folder / f"{name}.npz", values, np.ones((200, 3), bool))
        (folder / f"{name}.labels.csv").write_text(labels)
    return folder


def test_feature_packs_with_labels_beside_them(tmp_path: Path) -> None:
    people = load_people((packs(tmp_path, ("A1-1", "A1-2", "A2-1", "A3-1")),))
    assert people.names == ("A1", "A2", "A3")
    assert people.minutes == pytest.approx(4 * 6.0 / 60.0)
    assert set(people.files) >= {"A1-1/A1-1.npz", "A1-1/A1-1.labels.csv"}
    stream = people.sessions[0].stream
    assert stream.right(np.full(200, POUR))[100]
    assert not stream.known[180]
    # Two sessions of one person do not touch: between them is a window's length of nothing.
    own = people.stream.subject == 0
    assert own.sum() == 2 * (200 + 50)
    assert not people.stream.valid[200:250].any()


def test_labels_of_another_vocabulary_are_refused_with_file_and_line(tmp_path: Path) -> None:
    packs(tmp_path, ("A1-1",), LABELS + "7000,7500,Juggle,me\n")
    with pytest.raises(InputError, match=r"A1-1\.labels\.csv:5: 'Juggle' is no verb"):
        sessions_of(tmp_path, silent)


def test_a_recording_folder_of_the_iassistadl_group_needs_labels_of_its_own(tmp_path: Path) -> None:
    for subject, with_labels in (("BRAD-0701", True), ("CLEA-0702", False)):
        folder = tmp_path / subject / "session" / "recording"
        folder.mkdir(parents=True)
        seen = 1_760_000_000.0 + np.arange(1_600) / 200
        rows = [f"{544 + n % 9},{540},{t:.6f},{t + 0.002:.6f}" for n, t in enumerate(seen)]
        header = "gaze_x,gaze_y,gaze_sensor_timestamps,gaze_processing_timestamps"
        (folder / "gaze.csv").write_text("\n".join([header, *rows]) + "\n")
        if with_labels:
            (folder / "labels.csv").write_text(LABELS)
    (tmp_path / "BRAD-0701" / "session" / "recording" / "recording_metadata.toml").write_text(
        '[settings]\nsubject = "BRAD-0701"\n'
    )
    said: list[str] = []
    made = sessions_of(tmp_path, said.append)
    assert [session.person for session in made] == ["BRAD-0701"]
    assert made[0].stream.valid[5:, 0].all()
    assert made[0].stream.right(np.full(len(made[0].stream), CUT))[30]
    assert any("CLEA-0702" in line and "no labels.csv" in line for line in said)


def test_nothing_valid_at_all_is_said(tmp_path: Path) -> None:
    from hilbridge.learning.training.folds import losses_of

    people = load_people((packs(tmp_path, ("A1-1", "A2-1", "A3-1")),))
    assert len(losses_of(people.stream)) == 7
    people.stream.valid[:, 1:] = False
    assert losses_of(people.stream) == ((),)
    people.stream.valid[:] = False
    with pytest.raises(InputError, match="no step of any session has valid"):
        losses_of(people.stream)
