from functools import partial

import pytest

from hilbridge.errors import InputError
from hilbridge.learning.data.describe import describe
from hilbridge.learning.data.egtea import DatasetError
from hilbridge.learning.data.sessions import (
    load_features,
)
from tests.learning.package import ROW, package
from tests.sensors.begaze_lines import HEADER, OLD

pytest.importorskip("sklearn")


def test_sessions_are_packed_once_and_described_with_their_discards(tmp_path):
    from hilbridge.learning.data.packs import make_packs, missing

    root = package(
        tmp_path,
        "".join(
            ROW.format(n=n, s=1, start=start, end=start + 900, verb="Cut")
            for n, start in enumerate((1000, 5000, 60_000))
        ),
    )
    (root / "gaze_data").mkdir()
    rows = [f"{n}\tSMP\t1\t{640 + n % 7}\t480\t{n * 24 // 30}\t\t-" for n in range(300)]
    (root / "gaze_data" / "P01-R01-Soup.txt").write_text("\n".join([*HEADER, OLD, *rows]))
    fresh = load_features(root, "P01-R01-Soup")
    assert missing(root) == 1
    assert [path.name for path in make_packs(root)] == ["P01-R01-Soup.npz"]
    assert missing(root) == 0
    assert make_packs(root) == []
    assert all((one == other).all() for one, other in zip(load_features(root, "P01-R01-Soup"), fresh, strict=True))
    summary = describe(root)
    assert summary.packs == 1
    assert summary.pack_windows["P01-R01-Soup"].kept == 1
    assert "1 of 3 windows kept (discarded: 1 too early, 1 after the recording)" in "\n".join(summary.lines())
    with pytest.raises(DatasetError, match="no such folder"):
        make_packs(tmp_path / "absent")
    with pytest.raises(DatasetError, match="no pack, gaze or video"):
        load_features(root, "P02-R01-Soup")


def test_sessions_are_packed_by_several_at_once_as_by_one_after_the_other(tmp_path):
    from hilbridge.learning.data.packs import make_packs

    made = {}
    for jobs in (1, 2):
        root = package(tmp_path / str(jobs), ROW.format(n=0, s=1, start=1000, end=1900, verb="Cut"))
        (root / "gaze_data").mkdir()
        for person in range(3):
            rows = [f"{n}\tSMP\t1\t{640 + n % 7 + person}\t480\t{n * 24 // 30}\t\t-" for n in range(60)]
            (root / "gaze_data" / f"P0{person}-R01-Soup.txt").write_text("\n".join([*HEADER, OLD, *rows]))
        said, steps = [], []
        written = make_packs(root, False, partial(steps.append, 1), said.append, jobs=jobs)
        assert [path.name for path in written] == [f"P0{person}-R01-Soup.npz" for person in range(3)]
        assert [line.split(":")[0] for line in said] == [path.name for path in written]
        assert len(steps) == 3
        made[jobs] = [path.read_bytes() for path in written]
    assert made[1] == made[2]
    with pytest.raises(InputError, match="jobs 0"):
        make_packs(root, jobs=0)
