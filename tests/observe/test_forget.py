import pytest

from hilbridge.errors import InputError
from hilbridge.observe.forget import carry_out, plan_to_forget
from tests.labels.made import recording


def tree(tmp_path):
    """Two people, one of them twice; a foreign file; a file that only has the name; a damaged one."""
    recording(tmp_path / "a" / "recording.mcap", 1.0, "P-07")
    (tmp_path / "a" / "recording.labels.csv").write_text("")
    (tmp_path / "a" / "report.html").write_text("")
    recording(tmp_path / "b" / "recording.mcap", 1.0, "P-08")
    recording(tmp_path / "c" / "recording.mcap", 1.0, "P-07")
    (tmp_path / "c" / "thesis.tex").write_text("")
    (tmp_path / "notes-P-07.txt").write_text("")
    (tmp_path / "broken.mcap").write_bytes(b"no")
    return tmp_path


def names(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_one_person_goes_and_nobody_else(tmp_path):
    folder = tree(tmp_path)
    plan = plan_to_forget("P-07", folder)
    assert len(names(folder)) == 8  # a plan removes nothing
    assert carry_out(plan) == []
    assert names(folder) == ["b/recording.mcap", "broken.mcap", "c/thesis.tex", "notes-P-07.txt"]
    assert not (folder / "a").exists()
    assert [path.name for path in plan.named] == ["notes-P-07.txt"]
    assert [path.name for path, _ in plan.unread] == ["broken.mcap"]


def test_part_of_a_pseudonym_is_nobody(tmp_path):
    assert plan_to_forget("P-0", tree(tmp_path)).files == ()
    with pytest.raises(InputError, match="empty"):
        plan_to_forget("", tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        plan_to_forget("P-07", tmp_path / "absent")


def test_links_are_not_followed_out_of_the_folder(tmp_path):
    outside = recording(tmp_path / "outside" / "recording.mcap", 1.0, "P-07")
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "recording.mcap").symlink_to(outside)
    (inside / "folder").symlink_to(outside.parent)
    assert plan_to_forget("P-07", inside).files == ()
