"""Labels from ELAN (.eaf): every annotation of one tier. pympi reads the file; times are those of the video annotated."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hilbridge.errors import InputError, needs_extra
from hilbridge.labels.table import VOCABULARY, Label, in_order, label_of, read_text


def read_eaf(path: Path, tier: str | None, offset_ms: float, words: Sequence[str] = VOCABULARY) -> list[Label]:
    """Annotations of `tier`, or of the only tier that has any; `offset_ms` is added. Raises InputError."""
    text = read_text(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:  # no ELAN file has them; entities can be made to fill the memory
        raise InputError(f"{path}: has entities, which no ELAN file needs; save it with ELAN again")
    with needs_extra("labels"):
        from pympi.Elan import Eaf

    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints what it thinks of versions
            eaf: Any = Eaf(str(path))
    except Exception as error:  # whatever the XML parser and pympi raise for what is no ELAN file
        raise InputError(
            f"{path}: not an ELAN file ({type(error).__name__}: {error}); save it with ELAN again"
        ) from None
    filled = [name for name in eaf.get_tier_names() if eaf.get_annotation_data_for_tier(name)]
    if tier is None and len(filled) != 1:
        raise InputError(f"{path}: annotations in {len(filled)} tiers ({', '.join(filled)}); name one with --tier")
    name = filled[0] if tier is None else tier
    if name not in filled:
        raise InputError(f"{path}: no annotation in a tier {name!r}; there are {', '.join(filled) or 'none'}")
    labels = []
    for number, found in enumerate(sorted(eaf.get_annotation_data_for_tier(name)), 1):
        where = f"{path}: annotation {number} of tier {name}"
        labels.append(label_of(found[0] + offset_ms, found[1] + offset_ms, found[2], f"elan:{path.name}", where, words))
    return in_order(labels, str(path))
