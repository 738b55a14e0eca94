"""`rig.fleet_fit`: thousands of runs to one table, as `rig fleet fit` does it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pyarrow


def fleet_fit(
    runs: str | Path | Sequence[str | Path],
    kind: str | None = None,
    *,
    workers: int = 0,
    scheduler: str = "",
    output: str | Path | None = None,
    acceptance: str = "",
    mapped: str = "",
    no_tare: bool = False,
    store: bool = False,
    **settings: Any,
) -> pyarrow.Table:
    """Fit every run that is not fitted yet; returns the whole table of results, a row per quantity and run.

    `runs` are folders of runs, patterns, lists (.txt) or run files; `workers` processes of this computer fit them, or
    the dask cluster at `scheduler`. The table is kept in `output` ("fleet-results" in the first folder), and what is
    done is not done again. `acceptance` judges all gears instead of what their cards name, `mapped` ("from=to") says
    where workers see the runs, `store` keeps each analysis beside its run too. `settings` are those of the analysis.
    A script that asks for workers stands under `if __name__ == "__main__":`.

    Raises `ConfigurationError` for what names no run, `RigError` where results cannot be written, no scheduler answers,
    or the extra `fleet` is not installed. A run that cannot be analysed raises nothing: its row has `failure`.
    """
    from rig.fleet.dataset import DataSet
    from rig.fleet.engine import Workforce
    from rig.fleet.fit import FleetOrder, fit_fleet
    from rig.fleet.work import PathMap
    from rig.gears.card_places import places

    order = FleetOrder(
        names=places(runs),
        kind=kind or "",
        settings=settings,
        no_tare=no_tare,
        acceptance=acceptance,
        crew=Workforce(workers=workers, scheduler=scheduler),
        output=None if output is None else Path(output),
        mapped=PathMap.of(mapped) if mapped else PathMap(),
        stored=store,
    )
    return DataSet(fit_fleet(order).output).table()
