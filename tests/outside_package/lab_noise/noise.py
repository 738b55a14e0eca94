"""The analysis of torque noise; it is imported when a run is analysed."""

from __future__ import annotations

from lab_noise.protocol import NAME, QUANTITIES

from harmonic_rig.analyses import (
    Estimate,
    Evidence,
    Plot,
    Recording,
    Result,
    Series,
    check_recording,
    check_settings,
    student_quantile,
)

PIECES = 10
"""Pieces of the standstill whose noise is taken apart: their scatter gives the interval."""


def analyse(recording: Recording, evidence: Evidence) -> Result:
    """The standard deviation of the torque over pieces of the standstill: mean, and interval by their scatter."""
    check_settings(evidence.settings, (), NAME)
    recording.require("the torque noise", "torque")
    quality = check_recording(recording, "the torque noise", evidence.maximum_missed_share)
    (still,) = recording.labelled("hold")
    torque, time = recording.si("torque", still), recording.time(still)
    rows = len(torque) // PIECES * PIECES
    deviations = torque[:rows].reshape(PIECES, -1).std(axis=1, ddof=1)
    noise = float(deviations.mean())
    half = student_quantile(PIECES - 1) * float(deviations.std(ddof=1)) / PIECES**0.5
    estimate = Estimate(name="noise", value=noise, unit="N m", low=noise - half, high=noise + half)
    curve = Series(label="torque", x=time, y=torque)
    return Result(
        run=recording.metadata.run_id,
        kind=NAME,
        quantities=QUANTITIES,
        estimates={"noise": estimate},
        warnings=quality.warnings,
        plots=(
            Plot(
                name="torque",
                title="Torque",
                x_label="time [s]",
                y_label="torque [N m]",
                series=(curve,),
            ),
        ),
    )
