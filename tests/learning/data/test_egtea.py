import json

import pytest

from hilbridge.learning.data.describe import describe
from hilbridge.learning.data.egtea import DatasetError, load_actions, normalise_verb
from hilbridge.learning.data.sessions import (
    folds,
)
from hilbridge.verbs import OTHER, VERBS
from tests.learning.package import ROW, package

pytest.importorskip("sklearn")


@pytest.mark.data
def test_the_real_package_is_counted(egtea):
    summary = describe(egtea)
    assert (summary.annotations, summary.sessions, summary.subjects, summary.verbs) == (15_484, 86, 32, 22)
    assert len(summary.gaze) == 10
    assert sum(file.bad_lines for file in summary.gaze) == 0
    assert {file.version[:3] for file in summary.gaze} == {"3.1", "3.4"}
    assert summary.splits == {
        "test_split1": 2022,
        "test_split2": 2022,
        "test_split3": 2021,
        "train_split1": 8299,
        "train_split2": 8299,
        "train_split3": 8300,
    }
    assert all(file.annotated and file.windows.kept >= 0.9 * file.windows.onsets for file in summary.gaze)
    assert json.loads(json.dumps(summary.as_json()))["subjects"] == 32
    assert sum(summary.by_class.values()) == 15_484
    assert list(summary.by_class)[:3] == ["Take", "Put", "Open"]


def test_verbs_are_normalised():
    assert normalise_verb(" take ") == VERBS.index("Take")
    assert normalise_verb("inspect/READ") == VERBS.index("Inspect/Read")
    assert normalise_verb("Crack") == normalise_verb("Juggle") == OTHER


def test_a_missing_a_broken_and_an_empty_package_name_the_file(tmp_path):
    with pytest.raises(DatasetError, match="no such file"):
        load_actions(tmp_path)
    root = package(tmp_path / "a", ROW.format(n=1, s=1, start=0, end=9, verb="Cut") + "2; too; short\n")
    with pytest.raises(DatasetError, match="line 3"):
        load_actions(root)
    with pytest.raises(DatasetError, match="holds no annotation"):
        load_actions(package(tmp_path / "b", ""))


def test_too_few_subjects_for_the_folds_are_refused():
    with pytest.raises(ValueError, match="too few"):
        folds(["a", "b", "c"], 3)
