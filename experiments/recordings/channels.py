"""Which channel of a recording is meant: the one that the setting names, else the first of the
usual ones that is there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from experiments.errors import AnalysisError
from experiments.recording import Recording

ANGLES = ("input_angle", "position", "output_angle")
EFFORTS = ("torque", "drive_torque", "force", "current", "motor_current", "voltage")


def chosen_channel(
    recording: Recording,
    settings: Mapping[str, Any],
    key: str,
    usual: tuple[str, ...],
    purpose: str,
) -> str:
    """The name of a channel for `purpose`; `AnalysisError` where it is not there."""
    wanted = settings.get(key)
    if wanted is not None:
        recording.require(purpose, str(wanted))
        return str(wanted)
    for name in usual:
        if recording.has(name):
            return name
    raise AnalysisError(
        f"{purpose} needs a channel that this recording does not have",
        where=recording.metadata.run_id,
        value=" or ".join(usual),
        limit="channels " + ", ".join(sorted(recording.signals)),
        remedy=f"Name the channel with the setting {key}=NAME.",
    )
