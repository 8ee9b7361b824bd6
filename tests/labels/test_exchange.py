import pytest
from pympi.Elan import Eaf

from hilbridge.errors import InputError
from hilbridge.labels.exchange import export_labels, import_labels
from hilbridge.labels.store import labels_of
from hilbridge.labels.table import Label
from hilbridge.observe.reading import read_recording
from hilbridge.rows import LabelRow
from tests.labels.made import BEGIN_NS, FIRST_PICTURE_MS, recording


def eaf(path, *annotations, tier="verbs"):
    made = Eaf()
    made.add_tier(tier)
    for start_ms, end_ms, text in annotations:
        made.add_annotation(tier, start_ms, end_ms, text)
    made.to_file(str(path))
    return path


TABULAR_8 = """Observation id,Observation date,Media duration (s),Subject,Behavior,Behavior type,Time
one,2026-01-01,6,P-07,Pour,START,1.25
one,2026-01-01,6,P-07,Pour,STOP,2.5
"""
TABULAR_7 = """Observation id\tone
Media file(s)
Time\tMedia file path\tTotal length\tFPS\tSubject\tBehavior\tBehavioral category\tComment\tStatus
1.25\tx.mp4\t6\t25\tP-07\tPour\t\t\tSTART
2.5\tx.mp4\t6\t25\tP-07\tPour\t\t\tSTOP
"""
AGGREGATED = """Observation id,Subject,Behavior,Behavior type,Start (s),Stop (s),Duration (s)
one,P-07,Pour,STATE,1.25,2.5,1.25
"""


def test_labels_go_into_the_recording_and_beside_it_and_replace_those_before(tmp_path):
    path = recording(tmp_path / "recording.mcap")
    rows = list(read_recording(path))
    source = tmp_path / "mine.csv"
    for verb in ("Cut", "Pour"):
        source.write_text(f"start_ms,end_ms,verb,source\n1000,2000,{verb},me\n")
        beside, count = import_labels(path, source, None, None)
    assert (beside.name, count) == ("recording.labels.csv", 1)
    assert beside.read_text() == "start_ms,end_ms,verb,source\n1000,2000,Pour,me\n"
    again = list(read_recording(path))
    labels = [row for row in again if isinstance(row, LabelRow)]
    assert labels == [LabelRow(BEGIN_NS + 1_000_000_000, BEGIN_NS + 2_000_000_000, "Pour", "me")]
    assert [row for row in again if row not in labels] == rows
    assert again == sorted(again, key=lambda row: row.time_ns)
    assert path.stat().st_mode & 0o777 == 0o600


def test_export_gives_what_import_took(tmp_path):
    path, out = recording(tmp_path / "recording.mcap"), tmp_path / "out.csv"
    source = tmp_path / "mine.csv"
    source.write_text("start_ms,end_ms,verb,source\n0,400.5,none,me\n1000,2000,Cut,you\n")
    import_labels(path, source, None, None)
    assert export_labels(path, out) == 2
    assert out.read_text() == source.read_text()
    with pytest.raises(InputError, match="there already"):
        export_labels(path, out)


def test_elan_times_begin_with_the_first_picture(tmp_path):
    path = recording(tmp_path / "recording.mcap")
    import_labels(path, eaf(tmp_path / "x.eaf", (0, 1000, "pour"), (1500, 2000, "Cut")), None, None)
    assert labels_of(path) == [
        Label(FIRST_PICTURE_MS, FIRST_PICTURE_MS + 1000, "Pour", "elan:x.eaf"),
        Label(FIRST_PICTURE_MS + 1500, FIRST_PICTURE_MS + 2000, "Cut", "elan:x.eaf"),
    ]
    import_labels(path, tmp_path / "x.eaf", "verbs", 100.0)
    assert labels_of(path)[0].start_ms == 100


@pytest.mark.parametrize("text", [TABULAR_8, TABULAR_7, AGGREGATED], ids=["version 8", "version 7", "aggregated"])
def test_boris_tables(tmp_path, text):
    path, source = recording(tmp_path / "recording.mcap"), tmp_path / "boris.csv"
    source.write_text(text)
    import_labels(path, source, None, 0.0)
    assert labels_of(path) == [Label(1250, 2500, "Pour", "boris:boris.csv")]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (TABULAR_8.replace("Pour,START", "Pour,POINT"), "only pairs of START and STOP"),
        (TABULAR_8.rsplit("\n", 2)[0] + "\n", "never stops"),
        (TABULAR_8.replace("Pour", "Puor"), "did you mean `Pour`"),
        (AGGREGATED.replace("1.25,2.5,", "1.25,2000,"), "is it of another recording"),
        (AGGREGATED.replace("1.25,2.5,", "x,2.5,"), "no number"),
    ],
)
def test_what_boris_cannot_mean_is_one_line(tmp_path, text, said):
    path, source = recording(tmp_path / "recording.mcap"), tmp_path / "boris.csv"
    before = path.read_bytes()
    source.write_text(text)
    with pytest.raises(InputError) as caught:
        import_labels(path, source, None, 0.0)
    assert said in str(caught.value)
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir() if "partial" in one.name] == []


def test_elan_files_that_cannot_be_meant(tmp_path):
    path = recording(tmp_path / "recording.mcap")
    two = Eaf()
    for tier in ("left", "right"):
        two.add_tier(tier)
        two.add_annotation(tier, 0, 10, "Pour")
    two.to_file(str(tmp_path / "two.eaf"))
    bomb = '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bb">]><a>&b;</a>'
    (tmp_path / "bomb.eaf").write_text(bomb)
    (tmp_path / "no.eaf").write_text("not XML")
    eaf(tmp_path / "wrong.eaf", (0, 10, "Puor"))
    for name, tier, said in (
        ("two.eaf", None, "2 tiers"),
        ("two.eaf", "up", "there are"),
        ("bomb.eaf", None, "entities"),
        ("no.eaf", None, "not an ELAN file"),
        ("wrong.eaf", None, "did you mean `Pour`"),
        ("absent.eaf", None, "No such file"),
    ):
        with pytest.raises(InputError, match=r"\.eaf") as caught:
            import_labels(path, tmp_path / name, tier, 0.0)
        assert said in str(caught.value)


def test_a_recording_in_parts_keeps_each_label_in_its_part(tmp_path):
    recording(tmp_path / "recording.mcap")
    source = tmp_path / "mine.csv"
    source.write_text("start_ms,end_ms,verb\n100,200,Cut\n5900,5950,Pour\n")
    import_labels(tmp_path, source, None, None)
    assert [label.verb for label in labels_of(tmp_path)] == ["Cut", "Pour"]
