from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path

import pytest

from hilbridge.errors import InputError
from hilbridge.sensors import models


def test_a_fetched_model_is_the_pinned_one(hand_model: Path) -> None:
    assert models.hand_model_problem(hand_model) is None


def test_another_content_is_named(tmp_path: Path) -> None:
    path = tmp_path / "hand_landmarker.task"
    assert models.hand_model_problem(path) == "not there"
    path.write_bytes(b"no zip")
    assert "neither" in (models.hand_model_problem(path) or "")
    with zipfile.ZipFile(path, "w") as bundle:
        for name in models.WHEEL_PARTS:
            bundle.writestr(name, b"other weights")
    assert "another hash" in (models.hand_model_problem(path) or "")


def test_nothing_is_left_half_written_when_it_cannot_be_had(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(models, "HAND_MODEL_URL", "http://127.0.0.1:9/none")
    monkeypatch.setattr(models, "WHEEL", "mediapipe==0.0.0")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    path = tmp_path / "deep" / "hand_landmarker.task"
    with pytest.raises(InputError, match=r"neither the official file nor the mediapipe==0.0.0 wheel"):
        models.fetch_hand_model(path, timeout_s=1.0)
    assert not list(tmp_path.rglob("*"))


def test_the_official_hash_is_checked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    served = tmp_path / "official.task"
    served.write_bytes(b"official content")
    monkeypatch.setattr(models, "HAND_MODEL_URL", served.as_uri())
    monkeypatch.setattr(models, "HAND_MODEL_SHA256", hashlib.sha256(b"official content").hexdigest())
    target = models.fetch_hand_model(tmp_path / "user" / "hand_landmarker.task")
    assert target.read_bytes() == b"official content"
    said: list[str] = []
    models.fetch_hand_model(target, say=said.append)
    assert "already there" in said[0]


def test_the_hash_is_checked_at_loading(tmp_path: Path, hand_model: Path) -> None:
    assert models.load_hand_model(hand_model) == hand_model.read_bytes()
    other = tmp_path / "other.task"
    content = bytearray(hand_model.read_bytes())
    content[len(content) // 2] ^= 1
    other.write_bytes(content)
    with pytest.raises(InputError, match=r"other\.task: .*fetch-models --force.*hand_model_sha256"):
        models.load_hand_model(other)
    own = hashlib.sha256(content).hexdigest()
    assert models.load_hand_model(other, own.upper()) == content
    with pytest.raises(InputError, match=rf"other\.task: its sha256 is {own}, not the {'0' * 64}"):
        models.load_hand_model(other, "0" * 64)
    with pytest.raises(InputError, match=r"none\.task: not there"):
        models.load_hand_model(tmp_path / "none.task")
    with pytest.raises(InputError, match=r"cannot be read"):
        models.load_hand_model(tmp_path)
