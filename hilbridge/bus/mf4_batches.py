"""MF4 logs by the thousand frames: python-can hands asammdf each frame alone, which takes most of an export's time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hilbridge.bus.quick_can import can

_BATCH = 5_000
_Samples = tuple[NDArray[Any], None]


class _Batches:
    """Stands between python-can's writer and its asammdf file, with the three calls that the writer makes."""

    def __init__(self, mdf: Any) -> None:
        self._mdf = mdf
        self._waiting: dict[int, list[list[_Samples]]] = {}

    def extend(self, group: int, signals: list[_Samples]) -> None:
        """One frame: its stamp and its record."""
        waiting = self._waiting.setdefault(group, [])
        waiting.append(signals)
        if len(waiting) >= _BATCH:
            self._hand_over(group)

    def _hand_over(self, group: int) -> None:
        waiting = self._waiting.pop(group)
        columns = [np.concatenate([signals[place][0] for signals in waiting]) for place in range(len(waiting[0]))]
        self._mdf.extend(group, [(column, None) for column in columns])

    def save(self, *arguments: Any, **options: Any) -> None:
        """Write the file."""
        for group in list(self._waiting):
            self._hand_over(group)
        self._mdf.save(*arguments, **options)

    def close(self) -> None:
        """Release the file's temporary one."""
        self._mdf.close()


def in_batches(writer: can.MF4Writer) -> can.MF4Writer:
    """The same writer, which now hands over many frames at once."""
    writer._mdf = _Batches(writer._mdf)  # type: ignore[assignment]  # the library has no other place for it
    return writer
