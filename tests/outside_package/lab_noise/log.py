"""The logger of our old rig: a line of headings behind `#LAB`, then rows with a vertical bar between the numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harmonic_rig.importers import Importer


def read(path: Path) -> dict[str, np.ndarray]:
    """The columns by their heading, units in brackets."""
    first, *rows = path.read_text(encoding="utf-8").splitlines()
    if not first.startswith("#LAB "):
        raise ValueError("its first line does not begin with #LAB")
    headings = [heading.strip() for heading in first.removeprefix("#LAB ").split("|")]
    values = np.array([[float(cell) for cell in row.split("|")] for row in rows])
    return dict(zip(headings, values.T, strict=True))


IMPORTER = Importer("log of our old rig", read)
