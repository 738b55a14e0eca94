"""What was drawn of a rig: the errors of its encoders and its torque port, how the gear sits, what the day is."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass

from model.closed_loop import Deviations
from model.gear import Harmonic, HarmonicDrive
from model.units import REVOLUTION
from sim_backend.wear import Wear


@dataclass(frozen=True)
class EncoderErrors:
    """Where an encoder reads wrong: error [rad] over its own absolute angle, as a series; its
    sub-divisional error as one
    order of its lines; the angle of its index mark, and its latch delay [s]."""

    series: tuple[Harmonic, ...] = ()
    subdivision: Harmonic | None = None
    index_angle: float = 0.0
    skew: float = 0.0

    def turned(self, phase: float) -> EncoderErrors:
        """The same encoder over an angle that stands `phase` behind its own [rad]."""
        fine = self.subdivision
        return dataclasses.replace(
            self,
            series=turned_series(self.series, phase),
            subdivision=None if fine is None else turned_series([fine], phase)[0],
            index_angle=(self.index_angle - phase) % REVOLUTION,
        )


@dataclass(frozen=True)
class TorquePort:
    """How the torque monitor reads: gain error, zero [N m] and its drift [N m/K], noise [N m], lag [s]."""

    gain_error: float = 0.0
    offset: float = 0.0
    drift_per_kelvin: float = 0.0
    noise: float = 0.0


@dataclass(frozen=True)
class Sideband:
    """An order n + k/N of the gear's kinematic error, whatever the mounted ratio: cosine and sine [rad]; with n = 0
    it is one of the output."""

    order: int
    beside: int
    cosine: float
    sine: float


@dataclass(frozen=True, kw_only=True)
class Stated:
    """What a gear and a bench have, as it stands; the switches of `Imperfections` still take parts of it away."""

    deviations: Deviations
    sidebands: tuple[Sideband, ...]
    output_orders: tuple[Sideband, ...] = ()
    input_encoder: EncoderErrors
    output_encoder: EncoderErrors
    torque_port: TorquePort


@dataclass(frozen=True)
class Seating:
    """How the gear sits on the bench: how far the motor encoder's angle stands ahead of the wave
    generator's, and the output encoder's ahead of the gear's output, each in the encoder's own sense
    [rad]; and what the eccentricity of the mounting adds to the kinematic error [rad over theta_i].
    """

    input_phase: float = 0.0
    output_phase: float = 0.0
    eccentricity: tuple[Harmonic, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One rig in one world: everything that was drawn. `deviations` go into the plant, the rest into
    the instruments; all angles are the gear's own. `ambient` is the room's temperature [degC],
    `day_correlation` that of this bench's days, `dry_friction` the gear's dry friction in this run over its own, `wear`
    what its hours have done to it.
    """

    deviations: Deviations
    input_encoder: EncoderErrors
    output_encoder: EncoderErrors
    torque_port: TorquePort
    sync_jitter: float
    temperature_noise: float
    housing_offset: float
    start_angle: float
    input_count: int
    output_count: int
    ambient: float
    dry_friction: float
    clock_error: float = 0.0
    day_correlation: float = 0.0
    wear: Wear | None = None
    seating: Seating = Seating()

    def gear_of(self, gear: HarmonicDrive) -> HarmonicDrive:
        """The gear as it is in this run, after its hours."""
        gear = gear if self.wear is None else self.wear.worn(gear)
        dry = ("mesh_friction.coulomb", "mesh_friction.static")
        return gear.with_values({path: self.dry_friction * gear.value(path).value for path in dry})


def turned_series(series: Iterable[Harmonic], phase: float) -> tuple[Harmonic, ...]:
    """The same curve over an angle that stands `phase` behind its own [rad]."""
    return tuple(
        harmonic_of(h.order, h.amplitude, math.atan2(h.sine, h.cosine) - h.order * phase)
        for h in series
    )


def harmonic_of(order: float, amplitude: float, phase: float) -> Harmonic:
    """amplitude cos(order theta - phase)."""
    return Harmonic(order, float(amplitude * math.cos(phase)), float(amplitude * math.sin(phase)))
