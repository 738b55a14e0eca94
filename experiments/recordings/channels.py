"""Which channel of a recording is meant: the one that the setting names, else the first of the
usual ones that is there; and what the import states of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.errors import AnalysisError
from experiments.recording import Recording, mapping_of
from model.arrays import FloatArray


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


def stated(recording: Recording) -> Mapping[str, Any]:
    """What the import states of the device."""
    return mapping_of(recording.metadata.process.get("stated"))


def stated_lag(recording: Recording, name: str) -> float | None:
    """By how many seconds a channel is late, as the import states it; None where nobody does."""
    lags = mapping_of(stated(recording).get("lag_s"))
    return float(lags[name]) if name in lags else None


def brought_forward(
    recording: Recording, name: str, time: FloatArray, values: FloatArray
) -> FloatArray:
    """A channel (n,) at the times (n,) [s] at which it was, its stated lag taken off; its ends stay as they are."""
    lag = stated_lag(recording, name)
    return values if not lag else np.interp(time + lag, time, values)
