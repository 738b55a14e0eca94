"""Everything that makes the simulated rig worse than its model: a switch and a name for each, all on by default.

`Imperfections` says what is on, `Sizes` how large it is, `draw` makes of both one rig in one world
(`Condition`): phases, offsets and amplitudes drawn by seed, each from its own stream, so that
switching one off leaves the others as they were. Who owns what stands in `sim_backend.world`: the
bench its instruments and its motor, a mounting how the gear sits on it, a day the room and the zero
of the torque port, the run's number the noise.

The plant turns in the gear's own angles. What belongs to the bench (encoders, cogging) is drawn over
the bench's angles, which stand `Seating.input_phase` and `output_phase` ahead, and turned by as much.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drivers.errors import DriverError
from model.closed_loop import Deviations, Thermal
from model.gear import Harmonic, HarmonicDrive
from model.kinematic_error import series_value
from model.motor import ServoMotor
from model.units import ARCMIN, ARCSEC, DEGREE, REVOLUTION
from sim_backend.days import Days
from sim_backend.streams import stream
from sim_backend.wear import Wear
from sim_backend.world import ThermalState, World


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
            series=_turned(self.series, phase),
            subdivision=None if fine is None else _turned([fine], phase)[0],
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


def draw(
    imperfections: Imperfections, ratio: float, world: World, start: ThermalState | None = None
) -> Condition:
    """One rig in one world, drawn by its seeds; `start` is how warm it is, if not as the room."""
    on, sizes, bench = imperfections, imperfections.sizes, world.bench_seed
    run = stream(world.run_seed, "start")
    started = on.random_start
    angle = run.uniform(0.0, REVOLUTION * ratio)
    counts = run.integers(-(2**20), 2**20, 2)
    change = sizes.dry_friction_change * _bounded(stream(world.run_seed, "dry friction"))
    days = Days(world)
    room = days.within("ambient", -1.0, 1.0) * sizes.ambient_spread
    wear = Wear.of(world) if on.wear else None
    condition = Condition(
        deviations=_deviations(on, ratio, bench, world.gear_seed),
        input_encoder=_encoder(on, "input", world),
        output_encoder=_encoder(on, "output", world),
        torque_port=_torque_port(on, days),
        sync_jitter=sizes.sync_jitter if on.sync_jitter else 0.0,
        temperature_noise=sizes.temperature_noise if on.temperature_noise else 0.0,
        housing_offset=sizes.temperature_offset * _bounded(stream(bench, "thermometer"))
        if on.temperature_noise
        else 0.0,
        start_angle=float(angle) if started else 0.0,
        input_count=int(counts[0]) if started else 0,
        output_count=int(counts[1]) if started else 0,
        ambient=sizes.ambient + float(room) if on.ambient_temperature else Thermal().ambient,
        dry_friction=1.0 + change if on.run_to_run_friction else 1.0,
        clock_error=_clock_error(on, world),
        day_correlation=days.correlation,
        wear=wear,
    )
    if sizes.stated is not None:
        condition = _as_stated(condition, on, sizes.stated, ratio)
    condition = _seated(condition, _seating(on, ratio, world))
    return _at(_with_play(condition), start)


def _clock_error(on: Imperfections, world: World) -> float:
    """By what share the clock of the bench's stamps runs too fast."""
    if not on.clock_error or world.version < 2:
        return 0.0
    return on.sizes.clock_error * float(stream(world.bench_seed, "clock").uniform(-1.0, 1.0))


def _with_play(condition: Condition) -> Condition:
    """The condition with the backlash of a worn gear."""
    backlash = condition.wear.backlash if condition.wear else 0.0
    return dataclasses.replace(
        condition, deviations=dataclasses.replace(condition.deviations, backlash=backlash)
    )


def _seating(on: Imperfections, ratio: float, world: World) -> Seating:
    """What a mounting owns. Turning the gear on the output flange is an act, no imperfection: it is never off.

    A stated angle counts from where the first mounting had the gear, so that it is known between all that state one.
    """
    turn = world.mount_turn
    own = first = stream(world.mounting_seed, "phases").uniform(0.0, REVOLUTION, 2)
    if turn is not None and world.version >= 2:
        first = stream(world.seed_of_mounting(1), "phases").uniform(0.0, REVOLUTION, 2)
    output, wave_generator = on.sizes.eccentricity
    orders = ((1.0 / ratio, output), (1.0, wave_generator)) if on.eccentricity else ()
    return Seating(
        float(own[0]) if on.mounting else 0.0,
        (float(first[1]) if on.mounting else 0.0) + (turn or 0.0),
        _drawn(stream(world.mounting_seed, "eccentricity"), orders),
    )


def _seated(condition: Condition, seating: Seating) -> Condition:
    """The condition of a gear that sits so: what is the bench's, seen over the gear's own angles."""
    extra = condition.deviations
    return dataclasses.replace(
        condition,
        seating=seating,
        input_encoder=condition.input_encoder.turned(seating.input_phase),
        output_encoder=condition.output_encoder.turned(seating.output_phase),
        deviations=dataclasses.replace(
            extra,
            kinematic_error=(*extra.kinematic_error, *seating.eccentricity),
            cogging=_turned(extra.cogging, seating.input_phase),
        ),
    )


def _at(condition: Condition, start: ThermalState | None) -> Condition:
    """The condition in its room, as warm as it starts."""
    room, extra = condition.ambient, condition.deviations
    if extra.thermal is None:
        return condition
    warm = start or ThermalState(housing=room, motor=room)
    thermal = dataclasses.replace(
        extra.thermal, ambient=room, housing_start=warm.housing, motor_start=warm.motor
    )
    return dataclasses.replace(condition, deviations=dataclasses.replace(extra, thermal=thermal))


def _torque_port(on: Imperfections, days: Days) -> TorquePort:
    """The bench's gain, the day's zero."""
    sizes = on.sizes
    gain = sizes.torque_scale * _bounded(stream(days.world.bench_seed, "torque gain"))
    zero = sizes.torque_offset * days.normal("torque zero", _bounded)
    return TorquePort(
        gain if on.torque_scale_error else 0.0,
        zero if on.torque_offset else 0.0,
        sizes.torque_drift_per_kelvin if on.torque_offset and on.warming else 0.0,
        sizes.torque_noise if on.torque_noise else 0.0,
    )


def _as_stated(condition: Condition, on: Imperfections, stated: Stated, ratio: float) -> Condition:
    """The condition with what stands as it is, as far as it is switched on, in place of what was drawn about sizes."""
    have, port = stated.deviations, stated.torque_port
    bands = stated.output_orders if on.output_orders else ()
    bands += stated.sidebands if on.sidebands else ()
    deviations = dataclasses.replace(
        condition.deviations,
        kinematic_error=tuple(
            Harmonic(b.order + b.beside / ratio, b.cosine, b.sine) for b in bands
        ),
        hysteresis_torque=have.hysteresis_torque if on.hysteresis else 0.0,
        hysteresis_stiffness=have.hysteresis_stiffness if on.hysteresis else 0.0,
        output_coulomb=have.output_coulomb if on.output_bearing_friction else 0.0,
        output_viscous=have.output_viscous if on.output_bearing_friction else 0.0,
        output_per_kelvin=have.output_per_kelvin,
        cogging=have.cogging if on.motor_cogging else (),
        torque_constant_error=have.torque_constant_error if on.torque_scale_error else 0.0,
        port_lag=have.port_lag if on.torque_lag else 0.0,
        output_latch=stated.output_encoder.skew if on.channel_skew else 0.0,
        thermal=have.thermal if on.warming else None,
    )
    thermal = have.thermal
    return dataclasses.replace(
        condition,
        deviations=deviations,
        ambient=thermal.ambient if thermal and on.ambient_temperature else condition.ambient,
        input_encoder=_switched(stated.input_encoder, on),
        # Its skew is a matter of the plant: too long to be extrapolated from what is true at SYNC.
        output_encoder=dataclasses.replace(_switched(stated.output_encoder, on), skew=0.0),
        torque_port=dataclasses.replace(
            condition.torque_port,
            gain_error=port.gain_error if on.torque_scale_error else 0.0,
            offset=port.offset if on.torque_offset else 0.0,
        ),
    )


def _switched(encoder: EncoderErrors, on: Imperfections) -> EncoderErrors:
    """An encoder with those of its errors that are switched on."""
    return EncoderErrors(
        encoder.series if on.encoder_revolution_error else (),
        encoder.subdivision if on.sub_divisional_error else None,
        encoder.index_angle if on.random_start else math.pi,
        encoder.skew if on.channel_skew else 0.0,
    )


def _deviations(on: Imperfections, ratio: float, bench_seed: int, gear_seed: int) -> Deviations:
    """What the plant has and equation 2 has not."""
    sizes = on.sizes
    constant = sizes.torque_constant * _bounded(stream(bench_seed, "torque constant"))
    bearing = stream(bench_seed, "output bearing").uniform(0.8, 1.2, 2)
    return Deviations(
        kinematic_error=_added_orders(on, ratio, gear_seed),
        friction_windup=on.friction_windup,
        mesh_depth=sizes.mesh_depth if on.mesh_depth_friction else 0.0,
        hardening=on.hardening,
        hysteresis_torque=sizes.hysteresis_torque if on.hysteresis else 0.0,
        hysteresis_stiffness=sizes.hysteresis_stiffness if on.hysteresis else 0.0,
        output_coulomb=sizes.output_coulomb * float(bearing[0])
        if on.output_bearing_friction
        else 0.0,
        output_viscous=sizes.output_viscous * float(bearing[1])
        if on.output_bearing_friction
        else 0.0,
        motor_friction=on.motor_friction,
        cogging=_cogging(on, bench_seed),
        torque_constant_error=constant if on.torque_scale_error else 0.0,
        port_lag=sizes.torque_lag if on.torque_lag else 0.0,
        thermal=Thermal() if on.warming else None,
    )


def _added_orders(on: Imperfections, ratio: float, gear_seed: int) -> tuple[Harmonic, ...]:
    """Output orders k/N, and the sidebands n(1 + 1/N) and n + k/N, with drawn amplitudes and phases."""
    harmonics: tuple[Harmonic, ...] = ()
    if on.output_orders:
        orders = ((k / ratio, size) for k, size in enumerate(on.sizes.output_orders, start=1))
        harmonics += _drawn(stream(gear_seed, "output orders"), orders)
    if on.sidebands:
        bands = [(n * (1.0 + 1.0 / ratio), size) for n, size in on.sizes.wave_sidebands]
        bands += [(n + k / ratio, size) for n, k, size in on.sizes.output_sidebands]
        harmonics += _drawn(stream(gear_seed, "sidebands"), bands)
    return harmonics


def _cogging(on: Imperfections, bench_seed: int) -> tuple[Harmonic, ...]:
    """Cogging torque of the motor over its angle [N m]."""
    if not on.motor_cogging:
        return ()
    return _drawn(stream(bench_seed, "cogging"), on.sizes.motor_cogging)


def _drawn(
    random: np.random.Generator, sizes: Iterable[tuple[float, float]]
) -> tuple[Harmonic, ...]:
    """A harmonic for each order and size, its amplitude drawn about the size, at any phase."""
    return tuple(
        _harmonic(float(n), size * random.uniform(0.7, 1.3), random.uniform(0.0, REVOLUTION))
        for n, size in sizes
    )


def bench_encoder(on: Imperfections, which: str, world: World) -> EncoderErrors:
    """The "input" or "output" encoder of a bench over its own angle, whatever is mounted on it."""
    stated = on.sizes.stated
    if stated is None:
        return _encoder(on, which, world)
    return _switched(stated.input_encoder if which == "input" else stated.output_encoder, on)


def _encoder(on: Imperfections, which: str, world: World) -> EncoderErrors:
    """The errors of the "input" or "output" encoder."""
    sizes = on.sizes
    random = stream(world.bench_seed, f"{which} encoder")
    scale, phase = random.uniform(0.6, 1.4, 3), random.uniform(0.0, REVOLUTION, 4)
    once, twice, lines, fine, skew = (
        (
            sizes.input_once_per_turn,
            sizes.input_twice_per_turn,
            sizes.input_lines,
            sizes.input_subdivision,
            sizes.input_skew,
        )
        if which == "input"
        else (
            sizes.output_once_per_turn,
            sizes.output_twice_per_turn,
            sizes.output_lines,
            sizes.output_subdivision,
            sizes.output_skew,
        )
    )
    series = (_harmonic(1.0, once * scale[0], phase[0]), _harmonic(2.0, twice * scale[1], phase[1]))
    if which == "output" and world.version >= 2:
        series += _waviness(series, sizes, world.bench_seed)
    return EncoderErrors(
        series if on.encoder_revolution_error else (),
        _harmonic(float(lines), fine * scale[2], phase[2]) if on.sub_divisional_error else None,
        float(phase[3]) if on.random_start else math.pi,
        skew * float(random.uniform(0.7, 1.3)) if on.channel_skew else 0.0,
    )


def _waviness(slow: tuple[Harmonic, ...], sizes: Sizes, bench_seed: int) -> tuple[Harmonic, ...]:
    """Orders 3 to 8 of an output encoder whose orders 1 and 2 are known: all together within its class."""
    random = stream(bench_seed, "output encoder orders 3 to 8")
    raw = [
        _harmonic(float(n), random.uniform(0.0, 1.0), random.uniform(0.0, REVOLUTION))
        for n in range(3, 9)
    ]
    room = max(sizes.output_accuracy - half_width(slow), 0.0)
    size = min(sizes.output_waviness * random.uniform(0.6, 1.4), room) / half_width(raw)
    return tuple(Harmonic(h.order, size * h.cosine, size * h.sine) for h in raw)


def half_width(series: Iterable[Harmonic]) -> float:
    """Half the width of a curve of whole orders over one revolution, (largest - smallest)/2."""
    around = np.linspace(0.0, REVOLUTION, 7200, endpoint=False)
    return 0.5 * float(np.ptp(series_value(tuple(series), around)))


def _turned(series: Iterable[Harmonic], phase: float) -> tuple[Harmonic, ...]:
    """The same curve over an angle that stands `phase` behind its own [rad]."""
    return tuple(
        _harmonic(h.order, h.amplitude, math.atan2(h.sine, h.cosine) - h.order * phase)
        for h in series
    )


def _harmonic(order: float, amplitude: float, phase: float) -> Harmonic:
    """amplitude cos(order theta - phase)."""
    return Harmonic(order, float(amplitude * math.cos(phase)), float(amplitude * math.sin(phase)))


def _bounded(random: np.random.Generator) -> float:
    """A standard normal number, drawn again beyond three sigma."""
    while True:
        drawn = float(random.standard_normal())
        if abs(drawn) <= 3.0:
            return drawn


def individual_gear(nominal: HarmonicDrive, seed: int) -> HarmonicDrive:
    """One gear of a series: parameters drawn about the nominal ones, as one delivered part differs from the next.

    Mesh friction +-10 % (static stays above Coulomb), Stribeck velocity +-15 %, bearing and
    lubrication factor +-10 %, damping +-15 %, thickness of the cup's bottom +-3 % (the stiffness
    follows), amplitudes of the kinematic error +-20 % with phases turned by up to 20 degrees;
    standard deviations, each parameter from its own stream.
    """
    spread = {
        "mesh_friction.coulomb": 0.10,
        "mesh_friction.stribeck_velocity": 0.15,
        "mesh_friction.viscous": 0.10,
        "bearing.friction_factor": 0.10,
        "bearing.damping": 0.15,
        "cup.bottom_thickness": 0.03,
    }
    changes = {
        path: nominal.value(path).value * math.exp(size * _bounded(stream(seed, path)))
        for path, size in spread.items()
    }
    mesh = nominal.mesh_friction
    rise = (mesh.static - mesh.coulomb) * math.exp(
        0.15 * _bounded(stream(seed, "mesh_friction.static"))
    )
    changes["mesh_friction.static"] = changes["mesh_friction.coulomb"] + rise
    series = []
    for h in nominal.kinematic_error:
        random = stream(seed, f"kinematic error {h.order:.12g}")
        phase = math.atan2(h.sine, h.cosine) + random.uniform(-20.0, 20.0) * DEGREE
        series.append(_harmonic(h.order, h.amplitude * math.exp(0.2 * _bounded(random)), phase))
    return dataclasses.replace(nominal.with_values(changes), kinematic_error=tuple(series))


def individual_motor(nominal: ServoMotor, seed: int) -> ServoMotor:
    """One motor of a series: its own friction drawn +-10 % about the nominal one."""
    coulomb = nominal.coulomb_friction * math.exp(0.1 * _bounded(stream(seed, "motor coulomb")))
    viscous = nominal.viscous_friction * math.exp(0.1 * _bounded(stream(seed, "motor viscous")))
    return dataclasses.replace(nominal, coulomb_friction=coulomb, viscous_friction=viscous)
