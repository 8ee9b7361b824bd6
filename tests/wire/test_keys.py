from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_sim import secoc as device
from hilbridge.wire import keys
from hilbridge.wire.keys import DEMO_KEY, KeyFileError, load_key

requirement = pytest.mark.requirement


@requirement("P12")
def test_key_files_must_be_private(tmp_path: Path) -> None:
    path = tmp_path / "arm.key"
    path.write_text("00112233445566778899aabbccddeeff\n")
    for mode in (0o640, 0o604, 0o610, 0o601, 0o644):
        path.chmod(mode)
        with pytest.raises(KeyFileError) as raised:
            load_key(path, physical=False)
        assert str(raised.value) == f"{path}: key file is open to others; run `chmod 600 {path}`"
    path.chmod(0o600)
    assert load_key(path, physical=True) == bytes.fromhex("00112233445566778899aabbccddeeff")
    path.chmod(0o400)
    assert load_key(path, physical=False) == bytes.fromhex("00112233445566778899aabbccddeeff")


def test_a_system_without_modes_has_no_private_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "arm.key"
    path.write_text("00" * 16)
    path.chmod(0o644)
    monkeypatch.setattr(keys, "os", SimpleNamespace(name="nt"))
    assert load_key(path, physical=False) == bytes(16)


@requirement("P12")
@pytest.mark.parametrize("content", [b"", b"0011", b"nothing of the kind", b"\xff\xfe\x00", b"00" * 17])
def test_what_is_no_key_is_one_line(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "arm.key"
    path.write_bytes(content)
    path.chmod(0o600)
    with pytest.raises(KeyFileError) as raised:
        load_key(path, physical=False)
    assert str(raised.value).startswith(f"{path}: ")
    assert "\n" not in str(raised.value)
    with pytest.raises(KeyFileError, match="no such key file"):
        load_key(tmp_path / "none", physical=False)


@requirement("P12")
def test_h1_the_demo_key_is_refused_on_a_physical_bus(tmp_path: Path) -> None:
    assert load_key(None, physical=False) == DEMO_KEY == device.DEMO_KEY
    path = tmp_path / "arm.key"
    path.write_text(DEMO_KEY.hex())
    path.chmod(0o600)
    for source in (None, path):
        with pytest.raises(KeyFileError, match="refused on a physical bus"):
            load_key(source, physical=True)
