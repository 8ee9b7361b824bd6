"""Named signals on one uniform time grid: what expectations are judged on and conditions are checked against."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import nearest


class UnknownSignal(ValueError):
    """A name that no signal has; the text offers the nearest one."""


@dataclass(frozen=True, slots=True)
class Trace:
    """Signals sampled every `step_ms` from 0. Numbers are float64 (N,); words (states, reasons) are object arrays.

    A value holds until the next one comes, as a bus signal does.
    """

    step_ms: float
    length: int
    values: Mapping[str, NDArray[np.float64] | NDArray[np.object_]]
    silent: frozenset[str] = frozenset()  # signals that never had a value but their initial one

    def __getitem__(self, name: str) -> NDArray[np.float64] | NDArray[np.object_]:
        try:
            return self.values[name]
        except KeyError:
            raise UnknownSignal(f"no signal `{name}`; {nearest(name, self.values)}") from None


def sample_and_hold(
    events: Mapping[str, Sequence[tuple[float, float | str | bool]]],
    end_ms: float,
    step_ms: float = 1.0,
    initial: Mapping[str, float | str | bool] | None = None,
) -> Trace:
    """Put events (time in ms, value) of each signal on the grid; before its first event a signal has its `initial`.

    A signal without an initial value starts with its first one. Events of one signal must be in order of time.
    """
    length = round(end_ms / step_ms) + 1
    values: dict[str, NDArray[np.float64] | NDArray[np.object_]] = {}
    for name in sorted({*events, *(initial or {})}):
        rows = list(events.get(name, ()))
        first = (initial or {}).get(name, rows[0][1] if rows else 0.0)
        column = [first, *(value for _, value in rows)]
        steps = np.ceil(np.array([time_ms for time_ms, _ in rows]) / step_ms - 1e-9)
        index = np.searchsorted(steps, np.arange(length), side="right")
        values[name] = _column(column)[index]
    silent = frozenset(name for name in values if not events.get(name))
    return Trace(step_ms, length, values, silent)


def _column(values: Iterable[float | str | bool]) -> NDArray[np.float64] | NDArray[np.object_]:
    listed = list(values)
    if any(isinstance(value, str) for value in listed):
        return np.array([str(value) for value in listed], dtype=object)
    return np.array(listed, dtype=np.float64)
