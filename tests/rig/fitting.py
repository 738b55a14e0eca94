"""Several run files analysed with the same choices by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from model.gear import HarmonicDrive
from rig.analysis.fit.recorded import Fit
from rig.analysis.fit.run import Choices, fit_run


def fit_files(
    paths: Sequence[str | Path],
    kind: str = "",
    *,
    gear: HarmonicDrive | None = None,
    tare: str | Path | None = None,
    settings: Mapping[str, Any] | None = None,
    largest_missed_share: float | None = None,
) -> tuple[Fit, ...]:
    """Analyse several run files with the same choices by hand."""
    choices = Choices(
        gear=gear,
        tare=None if tare is None else Path(tare),
        settings=settings or {},
        largest_missed_share=largest_missed_share,
    )
    return tuple(fit_run(Path(path), kind, choices) for path in paths)
