"""An EGTEA Gaze+ package in small."""

from __future__ import annotations

from pathlib import Path

ROW = "{n}; clip; P0{s}-R01-Soup; {start}; {end}; {verb} it; {verb}; it\n"


def package(tmp_path: Path, lines: str) -> Path:
    """A data set's folder with these annotations and nothing else."""
    folder = tmp_path / "action_annotation" / "raw_annotations"
    folder.mkdir(parents=True)
    (folder / "action_labels.csv").write_text("# header\n" + lines)
    return tmp_path
