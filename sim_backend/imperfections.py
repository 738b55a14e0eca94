"""Everything that makes the simulated rig worse than its model: a switch and a name for each, all on by default.

`Imperfections` says what is on, `Sizes` how large it is; `sim_backend.drawing` makes of both one rig in one world.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from drivers.errors import DriverError
from model.units import ARCMIN, ARCSEC, REVOLUTION
from sim_backend.condition import Stated


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """How large each imperfection is, in SI. Random ones are drawn about these.

    Encoder errors are amplitudes of the angle; output orders and sidebands amplitudes at the gear's output; the torque
    port's offset and scale error are standard deviations of what is drawn; skews are mean latch delays after SYNC.
    Accuracies are classes: half the width of an encoder's whole curve, which its channel states. `stated` is what
    stands as it is, with nothing drawn about it. `eccentricity` is that of a mounting, as amplitudes at the output once
    per revolution of the output and of the wave generator; a day's temperature lies within `ambient_spread` of
    `ambient`; `dry_friction_change` is the standard deviation from run to run, as a share. `output_waviness` is the
    half-width of the output encoder's orders 3 to 8 together, as far as its class has room; `clock_error` bounds the
    share by which the clock of the stamps runs wrong.
    """

    input_accuracy: float = 1.4 * (60.0 + 25.0) * ARCSEC
    output_accuracy: float = 1.4 * (4.0 + 1.5) * ARCSEC
    input_lines: int = 8192
    output_lines: int = 18000
    multiplication: int = 4
    input_subdivision: float = 0.01 * REVOLUTION / 8192
    output_subdivision: float = 0.7 * ARCSEC
    input_once_per_turn: float = 60.0 * ARCSEC
    input_twice_per_turn: float = 25.0 * ARCSEC
    output_once_per_turn: float = 4.0 * ARCSEC
    output_twice_per_turn: float = 1.5 * ARCSEC
    output_waviness: float = 1.0 * ARCSEC
    output_orders: tuple[float, ...] = (
        0.035 * ARCMIN,
        0.02 * ARCMIN,
        0.01 * ARCMIN,
        0.007 * ARCMIN,
    )
    wave_sidebands: tuple[tuple[int, float], ...] = (
        (1, 0.006 * ARCMIN),
        (2, 0.03 * ARCMIN),
        (4, 0.006 * ARCMIN),
    )
    output_sidebands: tuple[tuple[int, int, float], ...] = (
        (2, -2, 0.012 * ARCMIN),
        (2, -1, 0.012 * ARCMIN),
        (2, 1, 0.012 * ARCMIN),
    )
    torque_offset: float = 0.006
    torque_drift_per_kelvin: float = 5e-5
    torque_scale: float = 0.01
    torque_lag: float = 0.4e-3
    torque_noise: float = 0.0015
    torque_constant: float = 0.01
    adc_volts: float = 0.3125e-3
    adc_step_counts: int = 4
    torque_per_volt_of_rated: float = 1.0
    motor_cogging: tuple[tuple[int, float], ...] = (
        (1, 0.0006),
        (4, 0.0005),
        (24, 0.0025),
        (48, 0.0006),
    )
    output_coulomb: float = 0.5
    output_viscous: float = 0.4
    mesh_depth: float = 0.10
    hysteresis_torque: float = 0.3
    hysteresis_stiffness: float = 0.012
    temperature_noise: float = 0.02
    temperature_offset: float = 0.1
    sync_jitter: float = 15e-6
    clock_error: float = 50e-6
    input_skew: float = 2e-6
    output_skew: float = 12e-6
    eccentricity: tuple[float, float] = (2.0 * ARCSEC, 1.0 * ARCSEC)
    ambient: float = 22.0
    ambient_spread: float = 1.5
    dry_friction_change: float = 0.01
    stated: Stated | None = None


@dataclass(frozen=True, kw_only=True)
class Imperfections:
    """The switches. Off means: as the model has it, or as a perfect instrument would.

    With `quantisation`, `adc_steps` or `drive_torque_steps` off the channel is counted so finely that its steps vanish.
    `mesh_depth_friction` off is the false case of figure 16: then only the wedge's own reaction varies with the angle.
    """

    quantisation: bool = True
    sub_divisional_error: bool = True
    encoder_revolution_error: bool = True
    output_orders: bool = True
    sidebands: bool = True
    torque_offset: bool = True
    torque_scale_error: bool = True
    torque_lag: bool = True
    torque_noise: bool = True
    adc_steps: bool = True
    drive_torque_steps: bool = True
    motor_friction: bool = True
    motor_cogging: bool = True
    output_bearing_friction: bool = True
    hardening: bool = True
    hysteresis: bool = True
    friction_windup: bool = True
    mesh_depth_friction: bool = True
    warming: bool = True
    temperature_noise: bool = True
    sync_jitter: bool = True
    clock_error: bool = True
    channel_skew: bool = True
    random_start: bool = True
    mounting: bool = True
    eccentricity: bool = True
    ambient_temperature: bool = True
    run_to_run_friction: bool = True
    wear: bool = True
    sizes: Sizes = field(default_factory=Sizes)

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The switches by name."""
        return tuple(f.name for f in dataclasses.fields(cls) if f.name != "sizes")

    @classmethod
    def none(cls) -> Imperfections:
        """A rig as good as its model, with instruments that see everything."""
        off: dict[str, Any] = dict.fromkeys(cls.names(), False)
        return cls(**off)

    def without(self, *names: str) -> Imperfections:
        """The same with these switched off."""
        off: dict[str, Any] = dict.fromkeys(self._checked(names), False)
        return dataclasses.replace(self, **off)

    def _checked(self, names: Iterable[str]) -> tuple[str, ...]:
        wanted, allowed = tuple(names), self.names()
        for name in wanted:
            if name not in allowed:
                raise DriverError(
                    "no such imperfection",
                    where="imperfections",
                    value=name,
                    limit=", ".join(allowed),
                )
        return wanted
