"""One recording of a joint in whatever form people keep such: proposed, answered, imported and fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from experiments.result import Result
from rig.analysis.fit.run import fit_run
from rig.commands.import_proposed import settled
from rig.runfile.importing.accepting import accepted
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.channel_source import parse_channel
from rig.runfile.importing.convert import import_tables
from rig.runfile.importing.opening import kind_of, open_tables
from rig.runfile.importing.proposal import propose
from rig.runfile.importing.stated import with_stated

INERTIA, VISCOUS, COULOMB, OFFSET = 0.05, 0.02, 0.3, 0.04
TIME = np.arange(2500) / 250.0
SPEED = 10.0 * np.sin(3.0 * TIME) + 4.0 * np.sin(7.3 * TIME)
ANGLE = -10.0 / 3.0 * np.cos(3.0 * TIME) - 4.0 / 7.3 * np.cos(7.3 * TIME)
TORQUE = (
    INERTIA * (30.0 * np.cos(3.0 * TIME) + 29.2 * np.cos(7.3 * TIME))
    + VISCOUS * SPEED
    + COULOMB * np.sign(SPEED)
    + OFFSET
    + 2e-3 * np.random.default_rng(4711).standard_normal(len(TIME))
)

_NOTHING: Mapping[str, Mapping[str, str]] = {"modulus": {}, "lag": {}, "accuracy": {}}


def run_of(
    files: Sequence[Path],
    folder: Path,
    answers: Mapping[str, str] | None = None,
    *,
    beside: Sequence[str] = (),
    stated: Mapping[str, Mapping[str, str]] | None = None,
    options: ImportOptions | None = None,
) -> Path:
    """The run that `rig import FILE` makes of these files; `answers` by a word of the question, Enter to
    all others."""
    options = ImportOptions(channels=()) if options is None else options
    kind, said = kind_of(files[0]), answers or {}
    proposal = settled(
        propose(open_tables(kind, files, options)),
        lambda text: next((answer for word, answer in said.items() if word in text), ""),
    )
    channels = tuple(map(parse_channel, beside))
    options = with_stated(accepted(options, proposal, channels), **{**_NOTHING, **(stated or {})})
    folder.mkdir(exist_ok=True)
    return import_tables(open_tables(kind, files, options), options, lambda: folder / "run.h5").path


def motion_of(run: Path) -> Result:
    return fit_run(run, "motion").result
