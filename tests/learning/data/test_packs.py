import pytest

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
