import json
from pathlib import Path

import pytest

from hilbridge.learning.data import aggregates
from hilbridge.learning.data.egtea import load_actions
from hilbridge.wearer import timeline

pytest.importorskip("sklearn")


@pytest.mark.data
def test_the_wearers_statistics_are_the_real_annotations_aggregates(egtea):
    made = aggregates.aggregate(load_actions(egtea))
    stored = json.loads((Path(timeline.__file__).parent / "statistics.json").read_text())
    assert made == stored
