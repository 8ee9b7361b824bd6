import errno

import pytest

from hilbridge.files import in_place_of, naming, write_whole


def test_a_file_is_made_with_its_folder_and_nothing_else_is_left(tmp_path):
    path = write_whole(tmp_path / "a" / "b.txt", "Grüße")
    assert path.read_text(encoding="utf-8") == "Grüße"
    assert [one.name for one in path.parent.iterdir()] == ["b.txt"]


def test_what_was_there_stays_when_writing_fails(tmp_path):
    path = write_whole(tmp_path / "x", b"before")

    def fails():
        with in_place_of(path) as partial:
            partial.write_bytes(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fails()
    assert path.read_bytes() == b"before"
    assert [one.name for one in tmp_path.iterdir()] == ["x"]


def test_a_full_disk_names_the_file_that_was_to_be(tmp_path):
    for guard in (naming, in_place_of):
        with pytest.raises(OSError, match=r"x\.bin") as caught, guard(tmp_path / "x.bin"):
            raise OSError(errno.ENOSPC, "No space left on device")
        assert caught.value.filename == str(tmp_path / "x.bin")


def test_the_name_in_between_is_nobodys_business(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileExistsError) as caught:
        write_whole(tmp_path / "file" / "x", "")
    assert "partial" not in str(caught.value)


def test_another_files_name_stays(tmp_path):
    with pytest.raises(FileNotFoundError) as caught, naming(tmp_path / "out"):
        (tmp_path / "absent").read_bytes()
    assert caught.value.filename.endswith("absent")
