"""`rig.simulate`: what the paper's model answers to an input, as a run in memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from experiments.recording import ArraySource, Recording, RunMetadata
from model.channel import Channel
from model.dynamics import simulate_prescribed
from model.units import RPM
from rig.api.runs import Run
from rig.errors import ConfigurationError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from model.arrays import FloatArray
    from model.gear import HarmonicDrive

_REST = 0.05
"""s of standstill before a step of the speed."""
UNITS = {
    "input_angle": ("rad", "input angle as prescribed"),
    "input_speed": ("rad/s", "input speed as prescribed"),
    "output_angle": ("rad", "output angle, equation 2"),
    "output_speed": ("rad/s", "output speed, equation 2"),
    "torque": ("N m", "torque on the wave generator, motor not included"),
    "cup_torque": ("N m", "torsion torque of the cup at the output"),
}
"""Channels of a simulation: unit, and what they are."""


def simulate(
    gear: HarmonicDrive,
    *,
    speed_rpm: float | None = None,
    duration: float = 0.5,
    input_angle: ArrayLike | None = None,
    rate: float = 10_000.0,
    load_torque: ArrayLike | None = None,
) -> Run:
    """What equation 2 of the paper answers to a prescribed input: the model alone, no rig, no noise, no fit.

    `speed_rpm` is a step of the input speed after 0.05 s of rest, held for `duration` [s]; `input_angle` (n,) [rad]
    instead is any motion from rest, sampled at `rate` [Hz]. `load_torque` [N m], a number or (n,), opposes the
    output. The run has input_angle, input_speed, output_angle, output_speed, torque and cup_torque in SI. A whole rig
    with its sensors is `rig.execute(..., backend="sim")`.

    Raises `ConfigurationError` unless one of the two inputs is given, `ModelError` for arrays that do not fit.
    """
    if (speed_rpm is None) == (input_angle is None):
        raise ConfigurationError(
            "needs one input",
            where="rig.simulate",
            limit="speed_rpm or input_angle",
            remedy="For instance: rig.simulate(gear, speed_rpm=600).",
        )
    if not 0.0 < rate < np.inf:
        raise ConfigurationError("is no sample rate", where="rate", value=rate, limit="> 0 Hz")
    if speed_rpm is None:
        assert input_angle is not None
        angle, speed = np.asarray(input_angle, dtype=np.float64), None
    else:
        angle, speed = _speed_step(speed_rpm * RPM, duration, rate)
    answer = simulate_prescribed(
        gear, angle, 1.0 / rate, input_speed=speed, load_torque=load_torque
    )
    arrays = {
        "input_angle": answer.input_angle,
        "input_speed": answer.input_speed,
        "output_angle": answer.output_angle,
        "output_speed": answer.output_speed,
        "torque": answer.wave_generator_torque,
        "cup_torque": answer.torsion_torque,
    }
    return _as_run(gear, arrays, rate)


def _as_run(gear: HarmonicDrive, arrays: dict[str, FloatArray], rate: float) -> Run:
    """Arrays (n,) by channel, at `rate` [Hz], as a run in memory."""
    signals = {
        name: Channel(name=name, unit=unit, is_counted=False, long_name=what)
        for name, (unit, what) in UNITS.items()
    }
    metadata = RunMetadata(
        run_id=f"model of {gear.name}",
        experiment="",
        origin="simulated",
        title=f"equation 2 of {gear.name}",
        gear=gear,
        ratio=gear.ratio,
        output_sense=1,
        sample_rate=rate,
        time_base="virtual",
        process={"backend": "model"},
    )
    times = np.rint(np.arange(len(arrays["input_angle"])) * (1e9 / rate)).astype(np.int64)
    return Run(Recording(metadata, signals, (), (), ArraySource(arrays, times)))


def _speed_step(speed: float, duration: float, rate: float) -> tuple[FloatArray, FloatArray]:
    """Angle and speed (n,) of a step from rest that is done within one sample."""
    if not (0.0 < duration < np.inf and np.isfinite(speed)):
        raise ConfigurationError(
            "is no step of the speed",
            where="rig.simulate",
            value=f"{speed / RPM:g} r/min for {duration:g} s",
            limit="finite, and a duration > 0 s",
        )
    rows = np.arange(round((_REST + duration) * rate) + 1)
    since = (rows - round(_REST * rate)) / rate
    turning = since > 0.0
    return speed * np.where(turning, since - 0.5 / rate, 0.0), speed * turning.astype(np.float64)
