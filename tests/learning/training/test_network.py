"""Real arm motion of ten people (seglearn's watch data) through the same training and calibration."""

import numpy as np
import pytest

pytest.importorskip("torch")

from hilbridge.features.layout import D
from hilbridge.intent.calibration import softmax
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.windows import window_ends
from hilbridge.learning.metrics import ece
from hilbridge.learning.training.fit import fit_isotonic, fit_temperature
from hilbridge.learning.training.recipes import Recipe
from hilbridge.learning.training.train import fit_network, predict_logits

RECIPE = Recipe(
    hidden=48,
    inner=32,
    dropout=0.0,
    epochs=6,
    windows_per_epoch=1_600,
    label_smoothing=0.0,
    class_weight_power=0.0,
    modality_dropout=0.0,
    jitter=0.0,
    learning_rate=4e-3,
    weight_decay=0.0,
    patience=99,
    seed=2,
)


def stream(data, people) -> Stream:
    """Watch signals at 25 Hz in the first six columns; every series is its own `subject`, so no window crosses."""
    values, labels, series = [], [], []
    for index in np.flatnonzero(np.isin(data["subject"], people)):
        signal = np.asarray(data["X"][index], dtype=np.float32)[::2]
        padded = np.zeros((len(signal), D), dtype=np.float32)
        padded[:, :6] = signal
        values.append(padded)
        labels.append(np.full(len(signal), int(data["y"][index])))
        series.append(np.full(len(signal), index))
    count = sum(len(part) for part in labels)
    empty = np.full(count, -1)
    return Stream(
        np.concatenate(series),
        np.concatenate(values),
        np.ones((count, 3), dtype=bool),
        np.concatenate(labels),
        empty,
        empty,
        empty,
        empty,
        np.zeros((count, 21), dtype=np.float32),
        np.ones(count, dtype=bool),
    )


@pytest.mark.slow
def test_calibration_improves_on_people_never_seen():
    data = pytest.importorskip("seglearn.datasets").load_watch()
    people = sorted(set(data["subject"].tolist()))
    assert len(people) == 10
    raw, scaled, mapped, right = [], [], [], []
    for turn in range(0, 10, 2):
        order = people[turn:] + people[:turn]
        test, validation, training = (stream(data, part) for part in (order[:2], order[2:4], order[4:]))
        trained = fit_network(RECIPE, training, validation)
        trained.network.load_state_dict(trained.last_weights)
        ends, held = window_ends(test, 10), window_ends(validation, 10)
        logits = predict_logits(trained.network, test, ends, trained.statistics)
        fitted = predict_logits(trained.network, validation, held, trained.statistics)
        labels = validation.label[held]
        temperature = fit_temperature(fitted, labels)
        confidence = softmax(fitted / temperature).max(axis=1)
        x, y = fit_isotonic(confidence, fitted.argmax(axis=1) == labels)
        raw.append(softmax(logits).max(axis=1))
        scaled.append(softmax(logits / temperature).max(axis=1))
        mapped.append(np.interp(scaled[-1], x, y))
        right.append(logits.argmax(axis=1) == test.label[ends])
    hits = np.concatenate(right)
    before, temperature_ece, isotonic_ece = (ece(np.concatenate(part), hits) for part in (raw, scaled, mapped))
    print(f"watch data: Top-1 {hits.mean():.3f}, ECE15 {before:.3f} -> {temperature_ece:.3f} / {isotonic_ece:.3f}")
    assert hits.mean() > 0.4
    assert temperature_ece < before
    assert isotonic_ece < before
