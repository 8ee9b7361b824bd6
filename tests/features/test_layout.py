from pathlib import Path

import numpy as np

from hilbridge.features.layout import FRAME, GAZE, HANDS, LAYOUT, MODALITY_OF, PATCH, D, drop_modality, markdown_table
from hilbridge.records import Modality

DOC = Path(__file__).parents[2] / "docs" / "features.md"


def test_layout_covers_every_index_once_and_slices_agree_with_names():
    assert [entry.index for entry in LAYOUT] == list(range(D))
    assert len({entry.name for entry in LAYOUT}) == D
    for part, prefix in ((GAZE, "gaze_"), (HANDS, "hand"), (FRAME, "frame_"), (PATCH, "patch_")):
        assert all(LAYOUT[index].name.startswith(prefix) for index in range(part.start, part.stop))
    assert PATCH.stop == D


def test_documentation_shows_the_layout_as_the_code_has_it():
    assert markdown_table() in DOC.read_text(encoding="utf-8")


def test_dropping_a_modality_zeroes_it_and_only_it():
    rng = np.random.default_rng(0)
    for modality in Modality:
        values = rng.uniform(0.1, 1.0, size=(4, D)).astype(np.float32)
        before = values.copy()
        valid = np.ones((4, 3), dtype=bool)
        drop_modality(values, valid, modality)
        own = int(modality) == MODALITY_OF
        assert (values[:, own] == 0.0).all()
        assert valid.sum() == 8
        untouched = ~own
        if modality is Modality.GAZE:
            assert (values[:, PATCH] == before[:, FRAME]).all()
            untouched[PATCH] = False
        assert (values[:, untouched] == before[:, untouched]).all()
