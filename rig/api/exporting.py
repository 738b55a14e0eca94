"""`rig.export_model`: an identified gear for other people's tools, as `rig export-model` writes it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rig.exchange.exporting import SUFFIXES, Target, default_name, exported, written
from rig.exchange.identified import identified_gear

if TYPE_CHECKING:
    from model.gear import HarmonicDrive
    from rig.exchange.joint import FormName, Side


def export_model(
    gear: HarmonicDrive | str | Path,
    path: str | Path | None = None,
    *,
    to: Target | None = None,
    side: Side = "joint",
    form: FormName = "lugre",
    samples: int = 0,
    seed: int = 0,
    check: bool = False,
    folder: str | Path = "runs",
) -> Path:
    """Write a gear for a simulator and return the file's path; notes, and draws where asked for, stand beside it.

    `gear` is a parameter set, its file or name, an analysed run file, or the serial number of a gear with analysed runs
    in `folder`. `to` follows from the suffix of `path`: .json, .xml (MJCF) or .urdf. `side` is where friction [N m]
    and inertia [kg m2] are stated; `form` MJCF's law of friction. With `check` the file is simulated in the target, and
    the notes hold the difference.

    Raises `RigError` for a gear of which nothing was identified, a target that is not installed, a file that cannot be
    written; `ParameterError` for a set that cannot be read.
    """
    known = identified_gear(gear, folder)
    target = to or _target_of(path)
    place = Path(path) if path is not None else Path(default_name(known, target))
    done = exported(
        known,
        target,
        side=side,
        form=form,
        draws=samples,
        seed=seed,
        is_checked=check,
        file=place.name,
    )
    return written(done, place)[0]


def _target_of(path: str | Path | None) -> Target:
    """The target whose files end as this path does; JSON without one."""
    from rig.errors import ConfigurationError

    suffix = Path(path).suffix.lower() if path is not None else ".json"
    for target, ending in SUFFIXES.items():
        if ending == suffix:
            return target
    raise ConfigurationError(
        "no target has files of this suffix",
        where="path",
        value=suffix,
        limit=", ".join(SUFFIXES.values()),
        remedy="Name the target: to='mjcf'.",
    )
