import numpy as np
import pytest

from hilbridge.errors import InputError
from hilbridge.features.layout import D
from hilbridge.features.packs import file_hash, pack_made_from, read_pack, write_pack
from hilbridge.learning.data.sessions import (
    recorded_sessions,
)

pytest.importorskip("sklearn")


def test_what_an_interruption_leaves_behind_is_no_session(tmp_path, monkeypatch):
    def interrupted(file, **_):
        file.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_pack(tmp_path / "feature_packs" / "P1.npz", np.zeros((3, D), np.float32), np.ones((3, 3), bool))
    assert recorded_sessions(tmp_path) == []


@pytest.mark.parametrize(
    "arrays",
    [
        {"values": np.zeros((3, 4)), "valid": np.zeros((3, 3))},
        {"values": np.full((3, D), np.nan), "valid": np.zeros((3, 3))},
        {"x": np.zeros(1)},
    ],
)
def test_what_is_no_feature_pack_is_refused(tmp_path, arrays):
    path = tmp_path / "bad.npz"
    np.savez(path, **arrays)
    with pytest.raises(InputError, match="extract it again"):
        read_pack(path)
    path.write_bytes(b"no zip")
    with pytest.raises(InputError, match="extract it again"):
        read_pack(path)


def test_a_pack_says_what_it_was_made_of_and_is_never_empty(tmp_path):
    source = tmp_path / "P1.txt"
    source.write_text("gaze")
    path = tmp_path / "P1.npz"
    write_pack(path, np.zeros((3, D), np.float32), np.ones((3, 3), bool), {source.name: file_hash(source)})
    assert pack_made_from(path) == {"P1.txt": file_hash(source)}
    assert read_pack(path)[0].shape == (3, D)
    with pytest.raises(InputError, match="no step"):
        write_pack(tmp_path / "empty.npz", np.zeros((0, D), np.float32), np.ones((0, 3), bool))
    assert not (tmp_path / "empty.npz").exists()
