"""A harmonic-drive test rig in Python: load or execute runs, fit them, compare them with the model, report them.

For instance::

    import rig

    run = rig.execute("friction", serial="SN-0815", seed=1)    # or rig.load("runs/00003.h5"), rig.read_csv(...)
    result = rig.fit(run)
    result["coulomb"].value, result["coulomb"].uncertainty     # SI, and U at 95 %
    result.plot("17").savefig("figure-17.png")

Names are imported when they are first used: `import rig` alone loads no array library. All errors that are meant for
the caller are `rig.WordedError`, with the words of the command line.

Inside, this is the application: what turns a rig, records it, judges what was recorded, and shows it. Eight
layers, checked by import-linter; each may import what stands below it::

    main                            the table of commands
    commands · window · api         what a person types, what a person sees, and what a program calls
    trial · fleet                   doctor, drill, demo: a rig turned for a purpose of its own; thousands of runs
    run · present · exchange        a protocol executed; one look for all that is shown; gears for other tools
    analysis                        fits, their store, what differs between runs, the passport of a gear
    gears · library · bench         gear cards; the index of runs; the physical rig: identity, limits, backends
    runfile                         the run file: layout, writing, reading, sealing, importing
    errors · exits                  what can go wrong, and what an ending means to whoever called

Start reading in `rig.main` (the commands) and `rig.run.session` (the one loop in which a rig turns).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from model.errors import WordedError
    from model.gear import HarmonicDrive
    from rig.api.executing import execute
    from rig.api.exporting import export_model
    from rig.api.fitting import fit
    from rig.api.fleets import fleet_fit
    from rig.api.gearing import gear
    from rig.api.reading import (
        from_pandas,
        load,
        read_csv,
        read_hdf5,
        read_json,
        read_mat,
        read_mdf,
        read_npz,
        read_parquet,
        read_tdms,
    )
    from rig.api.reporting import report
    from rig.api.results import Comparison, Result, Results, Value
    from rig.api.runs import Run
    from rig.api.simulating import simulate
    from rig.api.validating import Validated, validate

DISTRIBUTION = "harmonic-rig"

_PLACES = {
    "load": "rig.api.reading",
    "read_csv": "rig.api.reading",
    "read_mat": "rig.api.reading",
    "read_npz": "rig.api.reading",
    "read_hdf5": "rig.api.reading",
    "read_json": "rig.api.reading",
    "read_parquet": "rig.api.reading",
    "from_pandas": "rig.api.reading",
    "read_tdms": "rig.api.reading",
    "read_mdf": "rig.api.reading",
    "fit": "rig.api.fitting",
    "fleet_fit": "rig.api.fleets",
    "simulate": "rig.api.simulating",
    "execute": "rig.api.executing",
    "export_model": "rig.api.exporting",
    "gear": "rig.api.gearing",
    "report": "rig.api.reporting",
    "validate": "rig.api.validating",
    "Run": "rig.api.runs",
    "Result": "rig.api.results",
    "Results": "rig.api.results",
    "Comparison": "rig.api.results",
    "Value": "rig.api.results",
    "Validated": "rig.api.validating",
    "HarmonicDrive": "model.gear",
    "WordedError": "model.errors",
}
"""The public names and the modules that hold them. None is the name of a module: `rig.run` is a room."""

__all__ = [
    "load",
    "read_csv",
    "read_mat",
    "read_npz",
    "read_hdf5",
    "read_json",
    "read_parquet",
    "from_pandas",
    "read_tdms",
    "read_mdf",
    "fit",
    "fleet_fit",
    "simulate",
    "execute",
    "export_model",
    "gear",
    "report",
    "validate",
    "Run",
    "Result",
    "Results",
    "Comparison",
    "Value",
    "Validated",
    "HarmonicDrive",
    "WordedError",
]


def __getattr__(name: str) -> object:
    """A public name, its module imported now. Raises `ImportError` where a foreign package stands in the way."""
    if name not in _PLACES:
        raise AttributeError(f"module 'rig' has no attribute {name!r}")
    from importlib import import_module

    from rig.floors import refuse_foreign_floors

    refuse_foreign_floors()
    value = globals()[name] = getattr(import_module(_PLACES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
