"""The frames of a bus beside the run that they belong to: what was said before a trip."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rig.runfile.sealed import seal_in_place

if TYPE_CHECKING:
    from rig.bench.backends.assembly import AssembledRig
    from rig.run.parts import RunReport

_KEPT_S = 120.0
"""s before its end of which the frames are kept."""
SUFFIX = "-frames.log.gz"
"""What stands behind the name of a run in that of its frames: the format is that of python-can."""


def frames_of(run: Path) -> Path:
    """The file of a run's frames."""
    return run.with_name(run.name.removesuffix(".part").removesuffix(".h5") + SUFFIX)


def keep_frames(rig: AssembledRig, report: RunReport) -> None:
    """Write the last frames of a rig that is closed, and seal them; where that fails the report says so."""
    keep = rig.port.abilities.keep_frames
    if keep is None:
        return
    path = frames_of(report.path)
    try:
        keep(path, _KEPT_S)
        seal_in_place(path, path.read_bytes())
    except OSError as error:
        report.warnings.append(
            f"the frames of the bus were not kept: {path}: {error.strerror or error}"
        )
