"""Frames lost, in one meaning: the device sent them and they never came. What it withdrew itself was never sent. Pure.

Both sides number their frames, so a gap shows a frame that is missing. A device that was alone on the bus, or whose
computer stood still, has withdrawn frames after numbering them; it publishes how many (TxDropped, once a second). Until
that is known there is nothing to compare gaps with, and none counts.
"""

from __future__ import annotations


class Losses:
    """Told of the gaps so far with every reading of TxDropped."""

    def __init__(self) -> None:
        self._withdrawn: int | None = None  # the first reading, and the newest
        self._newest = 0
        self._gaps: int | None = None  # at the second reading: by then every gap of before the first has shown

    def on_withdrawn(self, withdrawn: int, gaps: int) -> None:
        """The device has told. One that has told of more before has begun anew."""
        if self._withdrawn is None or withdrawn < self._newest:
            self._withdrawn, self._gaps = withdrawn, None
        elif self._gaps is None:
            self._gaps = gaps
        self._newest = withdrawn

    def lost(self, gaps: int, withdrawn: int | None = None) -> int:
        """How many, of `gaps` so far. `withdrawn`: the device's last word, where that is known."""
        if self._gaps is None or self._withdrawn is None:
            return 0
        told = self._newest if withdrawn is None else withdrawn
        return max(0, gaps - self._gaps - (told - self._withdrawn))

    def before(self, gaps: int) -> int:
        """Gaps that say nothing, since nobody knew yet what had been withdrawn."""
        return gaps if self._gaps is None else self._gaps
