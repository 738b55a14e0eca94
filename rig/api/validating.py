"""`rig.validate`: models judged by runs that they were not fitted to, as `rig validate` does it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.analysis.fit.run import Choices
from rig.analysis.validate import validate_runs
from rig.api.runs import Run, file_of
from rig.api.tables import Tabular
from rig.content.data import data_grid
from rig.content.grid import Grid
from rig.errors import RigError
from rig.extras import optional

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from model.gear import HarmonicDrive
    from rig.analysis.validate import Validation

    OneRun = Run | str | Path


class Validated(Tabular):
    """A ladder of models, each with its hold-out error, skill against the null model, and BIC."""

    def __init__(self, validation: Validation) -> None:
        self.validation = validation
        """As the rest of the program has it (`rig.analysis.validate`)."""

    @property
    def best(self) -> str:
        """The model with the least hold-out error."""
        return self.validation.best.name

    @property
    def best_by_bic(self) -> str:
        """The model with the least BIC."""
        return self.validation.best_by_bic.name

    def to_pandas(self) -> pandas.DataFrame:
        """One row per model, errors in SI."""
        frame = optional("pandas", "a data frame of models").DataFrame
        return frame([rung.as_json() for rung in self.validation.rungs]).set_index("name")

    def plot(self) -> Figure:
        """What every model leaves of the fitted and of the held-out runs. A matplotlib figure."""
        from rig.present.figure import draw_figure

        return draw_figure(self.validation.plot(), self.validation.origin)

    def _grid(self) -> Grid:
        grid = data_grid(self.validation.table())
        best = f"least hold-out error: {self.best}; least BIC: {self.best_by_bic}"
        return replace(grid, note=f"{grid.note}\n{best}")


def validate(
    runs: Sequence[OneRun],
    on: Sequence[OneRun] = (),
    kind: str | None = None,
    *,
    tare: str | Path | None = "found",
    gear: HarmonicDrive | None = None,
    **settings: Any,
) -> Validated:
    """Fit every model of a ladder to run files, and judge it on those in `on`; without these each run in its turn.

    Kinds with a ladder are friction, kinematic-error and velocity-steps, the paper's model among each, and motion and
    order-spectrum for recordings of any origin. `tare`, `gear` and `settings` are those of `fit`. Raises `RigError` for
    fewer than two runs, and the errors of an analysis.
    """
    choices = Choices(
        gear=gear,
        tare=None if tare in ("found", None) else Path(str(tare)),
        no_tare=tare is None,
        settings=settings,
    )
    files, others = [_file(run) for run in runs], [_file(run) for run in on]
    return Validated(validate_runs(files, others, kind or "", choices))


def _file(run: OneRun) -> Path:
    path = file_of(run)
    if path is None:
        raise RigError(
            "a recording in memory cannot be validated: its tare and its gear are found beside its file",
            where=run.id if isinstance(run, Run) else "",
            remedy="Import it with `rig import`.",
        )
    return path
