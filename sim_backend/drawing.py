"""One rig in one world: phases, offsets and amplitudes drawn by seed, each from its own stream.

Switching an imperfection off leaves the others as they were. Who owns what stands in `sim_backend.world`: the bench its
instruments and its motor, a mounting how the gear sits on it, a day the room and the zero of the torque port, the run's
number the noise.

The plant turns in the gear's own angles. What belongs to the bench (encoders, cogging) is drawn over the bench's
angles, which stand `Seating.input_phase` and `output_phase` ahead, and turned by as much.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

import numpy as np

from model.closed_loop import Deviations, Thermal
from model.gear import Harmonic
from model.kinematic_error import series_value
from model.units import REVOLUTION
from sim_backend.condition import (
    Condition,
    EncoderErrors,
    Seating,
    Stated,
    TorquePort,
    harmonic_of,
    turned_series,
)
from sim_backend.days import Days
from sim_backend.imperfections import Imperfections, Sizes
from sim_backend.streams import bounded, stream
from sim_backend.wear import Wear
from sim_backend.world import ThermalState, World


def draw(
    imperfections: Imperfections, ratio: float, world: World, start: ThermalState | None = None
) -> Condition:
    """One rig in one world, drawn by its seeds; `start` is how warm it is, if not as the room."""
    on, sizes, bench = imperfections, imperfections.sizes, world.bench_seed
    run = stream(world.run_seed, "start")
    started = on.random_start
    angle = run.uniform(0.0, REVOLUTION * ratio)
    counts = run.integers(-(2**20), 2**20, 2)
    change = sizes.dry_friction_change * bounded(stream(world.run_seed, "dry friction"))
    days = Days(world)
    room = days.within("ambient", -1.0, 1.0) * sizes.ambient_spread
    wear = Wear.of(world) if on.wear else None
    thermometer = bounded(stream(bench, "thermometer"))
    condition = Condition(
        deviations=_deviations(on, ratio, world),
        input_encoder=_encoder(on, "input", world),
        output_encoder=_encoder(on, "output", world),
        torque_port=_torque_port(on, days),
        sync_jitter=_size(on.sync_jitter, sizes.sync_jitter),
        temperature_noise=_size(on.temperature_noise, sizes.temperature_noise),
        housing_offset=_size(on.temperature_noise, sizes.temperature_offset * thermometer),
        start_angle=_size(started, float(angle)),
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


def _size(is_on: bool, size: float) -> float:
    """How large an imperfection is: nothing where it is switched off."""
    return size if is_on else 0.0


def _clock_error(on: Imperfections, world: World) -> float:
    """By what share the clock of the bench's stamps runs too fast."""
    if not on.clock_error or world.version < 2:
        return 0.0
    return on.sizes.clock_error * float(stream(world.bench_seed, "clock").uniform(-1.0, 1.0))


def _with_play(condition: Condition) -> Condition:
    """The condition with the backlash of a worn gear."""
    if condition.wear is None:
        return condition
    backlash = condition.wear.backlash
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
        _size(on.mounting, float(own[0])),
        _size(on.mounting, float(first[1])) + (turn or 0.0),
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
            cogging=turned_series(extra.cogging, seating.input_phase),
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
    gain = sizes.torque_scale * bounded(stream(days.world.bench_seed, "torque gain"))
    zero = sizes.torque_offset * days.normal("torque zero", bounded)
    return TorquePort(
        _size(on.torque_scale_error, gain),
        _size(on.torque_offset, zero),
        _size(on.torque_offset and on.warming, sizes.torque_drift_per_kelvin),
        _size(on.torque_noise, sizes.torque_noise),
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
        hysteresis_torque=_size(on.hysteresis, have.hysteresis_torque),
        hysteresis_stiffness=_size(on.hysteresis, have.hysteresis_stiffness),
        output_coulomb=_size(on.output_bearing_friction, have.output_coulomb),
        output_viscous=_size(on.output_bearing_friction, have.output_viscous),
        output_per_kelvin=have.output_per_kelvin,
        cogging=have.cogging if on.motor_cogging else (),
        torque_constant_error=_size(on.torque_scale_error, have.torque_constant_error),
        port_lag=_size(on.torque_lag, have.port_lag),
        output_latch=_size(on.channel_skew, stated.output_encoder.skew),
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
            gain_error=_size(on.torque_scale_error, port.gain_error),
            offset=_size(on.torque_offset, port.offset),
        ),
    )


def _switched(encoder: EncoderErrors, on: Imperfections) -> EncoderErrors:
    """An encoder with those of its errors that are switched on."""
    return EncoderErrors(
        encoder.series if on.encoder_revolution_error else (),
        encoder.subdivision if on.sub_divisional_error else None,
        encoder.index_angle if on.random_start else math.pi,
        _size(on.channel_skew, encoder.skew),
    )


def _deviations(on: Imperfections, ratio: float, world: World) -> Deviations:
    """What the plant has and equation 2 has not."""
    sizes, bench_seed = on.sizes, world.bench_seed
    constant = sizes.torque_constant * bounded(stream(bench_seed, "torque constant"))
    coulomb = viscous = 0.0
    if on.output_bearing_friction:
        bearing = stream(bench_seed, "output bearing").uniform(0.8, 1.2, 2)
        coulomb, viscous = float(bearing[0]), float(bearing[1])
    return Deviations(
        kinematic_error=_added_orders(on, ratio, world.gear_seed),
        friction_windup=on.friction_windup,
        mesh_depth=_size(on.mesh_depth_friction, sizes.mesh_depth),
        hardening=on.hardening,
        hysteresis_torque=_size(on.hysteresis, sizes.hysteresis_torque),
        hysteresis_stiffness=_size(on.hysteresis, sizes.hysteresis_stiffness),
        hysteresis_by_slope=world.version < 3,
        output_coulomb=sizes.output_coulomb * coulomb,
        output_viscous=sizes.output_viscous * viscous,
        motor_friction=on.motor_friction,
        cogging=_cogging(on, bench_seed),
        torque_constant_error=_size(on.torque_scale_error, constant),
        port_lag=_size(on.torque_lag, sizes.torque_lag),
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
        harmonic_of(float(n), size * random.uniform(0.7, 1.3), random.uniform(0.0, REVOLUTION))
        for n, size in sizes
    )


def bench_encoder(on: Imperfections, which: str, world: World) -> EncoderErrors:
    """The "input" or "output" encoder of a bench over its own angle, whatever is mounted on it."""
    stated = on.sizes.stated
    if stated is None:
        return _encoder(on, which, world)
    return _switched(stated.input_encoder if which == "input" else stated.output_encoder, on)


_ENCODER = ("once_per_turn", "twice_per_turn", "lines", "subdivision", "skew")
"""What is sized of each encoder, "input" and "output"."""


def _encoder(on: Imperfections, which: str, world: World) -> EncoderErrors:
    """The errors of the "input" or "output" encoder."""
    sizes = on.sizes
    random = stream(world.bench_seed, f"{which} encoder")
    scale, phase = random.uniform(0.6, 1.4, 3), random.uniform(0.0, REVOLUTION, 4)
    once, twice, lines, fine, skew = (getattr(sizes, f"{which}_{part}") for part in _ENCODER)
    series = (
        harmonic_of(1.0, once * scale[0], phase[0]),
        harmonic_of(2.0, twice * scale[1], phase[1]),
    )
    if which == "output" and world.version >= 2:
        series += _waviness(series, sizes, world.bench_seed)
    return EncoderErrors(
        series if on.encoder_revolution_error else (),
        harmonic_of(float(lines), fine * scale[2], phase[2]) if on.sub_divisional_error else None,
        float(phase[3]) if on.random_start else math.pi,
        _size(on.channel_skew, skew * float(random.uniform(0.7, 1.3))),
    )


def _waviness(slow: tuple[Harmonic, ...], sizes: Sizes, bench_seed: int) -> tuple[Harmonic, ...]:
    """Orders 3 to 8 of an output encoder whose orders 1 and 2 are known: all together within its class."""
    random = stream(bench_seed, "output encoder orders 3 to 8")
    raw = [
        harmonic_of(float(n), random.uniform(0.0, 1.0), random.uniform(0.0, REVOLUTION))
        for n in range(3, 9)
    ]
    room = max(sizes.output_accuracy - half_width(slow), 0.0)
    size = min(sizes.output_waviness * random.uniform(0.6, 1.4), room) / half_width(raw)
    return tuple(Harmonic(h.order, size * h.cosine, size * h.sine) for h in raw)


def half_width(series: Iterable[Harmonic]) -> float:
    """Half the width of a curve of whole orders over one revolution, (largest - smallest)/2."""
    around = np.linspace(0.0, REVOLUTION, 7200, endpoint=False)
    return 0.5 * float(np.ptp(series_value(tuple(series), around)))
