"""What only a simulated rig knows: every parameter that was drawn, as plain JSON-able data.

No code that analyses a run has a part in it. Two truths stand side by side: the gear (or the motor)
alone, and what this bench adds to it, each thing by its name (`torque_port`, `encoders`, the output
bearing of `friction`, the eccentricity of the mounting). How a quantity is made of them says
`experiments.truth`.

friction          the gear alone at `thermal.reference`, at 20 degC and at the temperature at which the run
                  starts; dry parts fall by `coulomb_per_kelvin` of themselves per kelvin, viscous ones as
                  exp(-viscous_per_kelvin dT), what the bearing's no-load torque (equation 18) has beyond standstill
                  as that to 2/3. Beside it the bench's output bearing.
kinematic_error   "orders" is the gear alone, "measurable" what the two counters can see, gear, mounting and
                  encoders together; both over the input angle from the index marks (the input's mark at or before the
                  output's). "measurable_recorded" is the same over the recorded input angle (counts times
                  scale), to be laid on a fit of raw counts without any shift. The peak-to-peak "of slow orders" leaves
                  out those orders above 8 of the output encoder which nothing else has: no fit looks for them.
dynamics          with the wave generator held, at a torque amplitude of T1/4 at the output: the torsion that spring
                  and hysteresis element make of it, the secant stiffness, and the first mode of equation 2 beside
                  them: natural frequency |lambda|/(2 pi) and damping ratio -Re lambda/|lambda| of its eigenvalue.
"""

from __future__ import annotations

import cmath
import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from model import friction
from model.closed_loop import ClosedLoop, Thermal
from model.gear import Harmonic, HarmonicDrive
from model.kinematic_error import peak_to_peak, series_value
from model.motor import ServoMotor
from model.units import REVOLUTION
from sim_backend.condition import Condition, EncoderErrors
from sim_backend.imperfections import Imperfections
from sim_backend.sensors import SLOW, Instruments
from sim_backend.world import World

REFERENCE = 20.0
"""degC at which every friction number is also stated."""


def tell(
    loop: ClosedLoop,
    motor: ServoMotor,
    on: Imperfections,
    condition: Condition,
    instruments: Instruments,
    world: World,
    output_sense: int,
) -> dict[str, object]:
    """The truth of one simulated rig in one world."""
    mounted = loop.settings.gear_mounted
    thermal = condition.deviations.thermal
    truth: dict[str, object] = {
        "imperfections": {name: bool(getattr(on, name)) for name in on.names()},
        "sizes": dataclasses.asdict(dataclasses.replace(on.sizes, stated=None)),
        "world": dataclasses.asdict(world),
        "motor": _motor(motor, condition),
        "torque_port": _torque_port(condition),
        "encoders": _encoders(instruments, condition, output_sense),
        "thermal": dataclasses.asdict(thermal) if thermal else {},
        "thermometer": {"housing_offset": condition.housing_offset},
        "timing": _timing(condition),
        "mounting": {
            "turn": world.mount_turn,
            "input_phase": condition.seating.input_phase,
            "output_phase": condition.seating.output_phase,
            "eccentricity": _orders(condition.seating.eccentricity),
        },
        "day": {"correlation": condition.day_correlation},
        "start_angle": condition.start_angle,
        "gear_mounted": mounted,
        "inertia": {
            "motor": motor.rotor_inertia,
            "disc": loop.settings.disc_inertia,
            "total_at_input": loop.inertia,
        },
    }
    if mounted:
        truth["wear"] = _wear(condition)
        truth["friction"] = _friction(loop, condition)
        truth["kinematic_error"] = _kinematic_error(loop, condition, instruments, output_sense)
        truth["dynamics"] = _dynamics(loop)
    return truth


def _timing(condition: Condition) -> dict[str, float]:
    """When each encoder is latched after its SYNC [s], and how wrong the clock is."""
    early = condition.input_encoder.skew
    late = condition.output_encoder.skew + condition.deviations.output_latch
    return {
        "sync_jitter": condition.sync_jitter,
        "input_skew": early,
        "output_skew": late,
        "skew": late - early,
        "clock_error": condition.clock_error,
    }


def _wear(condition: Condition) -> dict[str, float]:
    """What hours have done to the gear; every other part of the truth is that of the gear as it is now."""
    wear = condition.wear
    if wear is None:
        return {}
    rates = dataclasses.asdict(wear)
    return {
        "hours": rates.pop("hours"),
        **{f"{name}_per_1000_hours": rate for name, rate in rates.items()},
        "backlash": wear.backlash,
    }


def _friction(loop: ClosedLoop, condition: Condition) -> dict[str, object]:
    """Friction of the gear alone at three temperatures, and beside it the bench's output bearing, also as the
    forces at the mesh that would make the same torque at the input."""
    gear, extra = loop.gear, loop.deviations
    bearing, low = gear.bearing, gear.options.low_speed_branch
    lever = friction.mesh_lever(gear) * gear.ratio / loop.ratio
    heat = extra.thermal or Thermal()
    own = _mesh(gear, 1.0, 1.0)
    return {
        **own,
        "at_20_degrees": _at(gear, heat, REFERENCE),
        "at_start": {"temperature": heat.housing_start, **_at(gear, heat, heat.housing_start)},
        "dry_friction_of_this_run": condition.dry_friction,
        "torque_balance": gear.options.torque_balance,
        "mesh_lever": lever,
        "bearing_lever": friction.bearing_lever(gear),
        "bearing_torque": {
            "friction_factor": bearing.friction_factor,
            "viscosity": bearing.viscosity,
            "pitch_diameter": bearing.pitch_diameter,
            "low_speed_branch": low,
        },
        "mesh_depth": extra.mesh_depth,
        "output_bearing_coulomb": extra.output_coulomb,
        "output_bearing_viscous": extra.output_viscous,
        "output_bearing_per_kelvin": extra.output_per_kelvin,
        "output_bearing_at_mesh": {
            "coulomb": extra.output_coulomb / (loop.ratio * lever),
            "viscous": extra.output_viscous / (loop.ratio**2 * lever),
        },
    }


def _at(gear: HarmonicDrive, heat: Thermal, temperature: float) -> dict[str, float]:
    """The mesh friction of the gear alone at a temperature of its housing [degC]."""
    warmer = temperature - heat.reference
    return _mesh(
        gear,
        1.0 - heat.coulomb_per_kelvin * warmer,
        math.exp(-heat.viscous_per_kelvin * warmer),
    )


def _mesh(gear: HarmonicDrive, dry: float, thin: float) -> dict[str, float]:
    """Equation 19 with its dry and its viscous parts times a factor each."""
    mesh = gear.mesh_friction
    return {
        "coulomb": dry * mesh.coulomb,
        "static": dry * mesh.static,
        "stribeck_velocity": mesh.stribeck_velocity,
        "shape": mesh.shape,
        "viscous": thin * mesh.viscous,
    }


def _kinematic_error(
    loop: ClosedLoop, condition: Condition, instruments: Instruments, output_sense: int
) -> dict[str, object]:
    """The gear's own series, and the sum with both encoders' errors over the recorded input angle."""
    ratio = loop.ratio
    seen = [_complex(h) for h in loop.series]
    seen += [(h.order, -complex(h.cosine, -h.sine) / ratio) for h in condition.input_encoder.series]
    for h in condition.output_encoder.series:
        # The output encoder's own angle is sense * theta_o; theta_o is positive when it follows.
        seen.append((h.order / ratio, output_sense * complex(h.cosine, -output_sense * h.sine)))
    summed = _summed(seen)
    fitted = [h.order for h in loop.series]
    fitted += [h.order for h in condition.input_encoder.series]
    fitted += [h.order / ratio for h in condition.output_encoder.series if h.order <= SLOW]
    mark = _reference_mark(condition, ratio, output_sense)
    offset = instruments.input.angle_offset
    added = condition.seating.eccentricity
    own = [
        _harmonic(order, value * cmath.exp(1j * order * mark))
        for order, value in (_complex(h) for h in loop.series if h not in added)
    ]
    marked = [
        _harmonic(order, value * cmath.exp(1j * order * mark))
        for order, value in sorted(summed.items())
    ]
    slow = [h for h in marked if any(abs(h.order - order) < 1e-9 for order in fitted)]
    recorded = [
        _harmonic(order, value * cmath.exp(-1j * order * offset))
        for order, value in sorted(summed.items())
    ]
    return {
        "orders": _orders(own),
        "measurable": _orders(marked),
        "measurable_recorded": _orders(recorded),
        "eccentricity": _orders(added),
        "peak_to_peak": peak_to_peak(own, ratio, 120),
        "measurable_peak_to_peak": peak_to_peak(marked, ratio, 120),
        "measurable_peak_to_peak_of_slow_orders": peak_to_peak(slow, ratio, 120),
        "reference_angle": mark + offset,
        "input_subdivision": _amplitude(condition.input_encoder.subdivision),
        "output_subdivision": _amplitude(condition.output_encoder.subdivision),
    }


def _summed(waves: Iterable[tuple[float, complex]]) -> dict[float, complex]:
    """By order, what all waves make together."""
    summed: dict[float, complex] = {}
    for order, amplitude in waves:
        key = next((other for other in summed if abs(other - order) < 1e-9), order)
        summed[key] = summed.get(key, 0.0) + amplitude
    return summed


def _reference_mark(condition: Condition, ratio: float, output_sense: int) -> float:
    """The true input angle of the input's index mark at or before the output's [rad]."""
    first = condition.input_encoder.index_angle
    passes = ratio * output_sense * condition.output_encoder.index_angle
    return first + REVOLUTION * math.floor((passes - first) / REVOLUTION)


def _complex(h: Harmonic) -> tuple[float, complex]:
    """Order and c with a cos(n x) + b sin(n x) = Re c exp(i n x)."""
    return h.order, complex(h.cosine, -h.sine)


def _harmonic(order: float, amplitude: complex) -> Harmonic:
    return Harmonic(order, amplitude.real, -amplitude.imag)


def _orders(series: Iterable[Harmonic]) -> list[dict[str, float]]:
    return [
        {"order": h.order, "cosine": h.cosine, "sine": h.sine, "amplitude": h.amplitude}
        for h in series
    ]


def _amplitude(h: Harmonic | None) -> float:
    return 0.0 if h is None else h.amplitude


@dataclass(frozen=True, kw_only=True)
class _Winding:
    """Torque over torsion of the gear's spring with its play (to either side) and its kinks, and of the hysteresis
    element parallel to it (Dahl)."""

    stiffness: float
    play: float
    kinks: tuple[tuple[float, float], ...]
    limit: float
    initial: float

    @staticmethod
    def of(loop: ClosedLoop) -> _Winding:
        gear, extra, first = loop.gear, loop.deviations, loop.parameters.combined_stiffness
        rated = gear.ratings
        second, third = (
            first * k / rated.stiffness_1 for k in (rated.stiffness_2, rated.stiffness_3)
        )
        knee = rated.torque_1 / first
        knees = (
            (knee, second - first),
            (knee + (rated.torque_2 - rated.torque_1) / second, third - second),
        )
        return _Winding(
            stiffness=first,
            play=0.5 * extra.backlash,
            kinks=knees if extra.hardening else (),
            limit=extra.hysteresis_torque,
            initial=extra.hysteresis_stiffness * first if extra.hysteresis_torque else 0.0,
        )

    def hysteresis(self, torsion: float) -> float:
        """The element's torque at the end of a swing between -torsion and torsion, over and over."""
        if not self.limit:
            return 0.0
        return self.limit * math.tanh(self.initial * torsion / self.limit)

    def torque(self, torsion: float) -> float:
        """At the end of such a swing [N m]."""
        taut = max(torsion - self.play, 0.0)
        harder = sum(step * max(0.0, taut - knee) for knee, step in self.kinks)
        return self.stiffness * taut + harder + self.hysteresis(torsion)

    def torsion(self, torque: float) -> float:
        """The swing that needs this torque [rad]."""
        low, high = 0.0, self.play + torque / self.stiffness
        while high - low > 1e-13 * high:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.torque(middle) < torque else (low, middle)
        return 0.5 * (low + high)

    def loss(self, torsion: float) -> float:
        """Work that such a swing takes, there and back [J]."""
        if not self.limit:
            return 0.0
        return 4.0 * self.limit * (torsion - self.hysteresis(torsion) / self.initial)


def _dynamics(loop: ClosedLoop) -> dict[str, object]:
    """The spring, its secant at T1/4, and the mode of the gear alone and with the bench's output bearing."""
    gear, extra, winding = loop.gear, loop.deviations, _Winding.of(loop)
    amplitude = 0.25 * gear.ratings.torque_1
    swing = winding.torsion(amplitude)
    secant = amplitude / swing
    alone, on_bench = (
        _mode(loop, winding, swing, viscous) for viscous in (0.0, extra.output_viscous)
    )
    return {
        "torque_amplitude": amplitude,
        "torsion_amplitude": swing,
        "stiffness": secant,
        "stiffness_over_inertia": secant / gear.inertia.output,
        "resonance": abs(alone) / (2.0 * math.pi),
        "damping_ratio": -alone.real / abs(alone),
        "damping_ratio_with_output_bearing": -on_bench.real / abs(on_bench),
        "output_inertia": gear.inertia.output,
        "input_inertia": loop.rotor_inertia,
        "radial_damping": gear.bearing.damping,
        "structural_damping": gear.damping.structural,
        "spring": {
            "stiffness": winding.stiffness,
            "backlash": extra.backlash,
            "kinks": [{"torsion": knee, "stiffer_by": step} for knee, step in winding.kinks],
        },
        "hysteresis": {"torque": winding.limit, "stiffness": winding.initial},
        "ratio": loop.ratio,
    }


def _mode(loop: ClosedLoop, winding: _Winding, swing: float, viscous: float) -> complex:
    """The eigenvalue of the first mode of equation 2 with the input held.

    Beside the linear gear stand a spring and a damper that do over a swing what kinks and hysteresis do, and the
    viscous friction of the output bearing [N m s/rad].
    """
    p = loop.parameters
    s, c = math.sin(p.tooth_angle), math.cos(p.tooth_angle)
    square = p.neutral_radius**2
    beside = winding.torque(swing) / swing - winding.stiffness
    cup, mesh = p.cup_stiffness / square, p.mesh_stiffness
    stiffness = np.array(
        [
            [p.bearing_stiffness + mesh * s * s, -mesh * s * c, 0.0],
            [-mesh * s * c, mesh * c * c + cup, -cup],
            [0.0, -cup, cup + beside / square],
        ]
    )
    masses = np.array([p.flexspline_inertia, p.flexspline_inertia, p.output_inertia]) / square
    lossy = p.structural_damping / square
    value = 1j * math.sqrt((winding.stiffness + beside) / p.output_inertia)
    for _ in range(3):
        lost = winding.loss(swing) / (math.pi * abs(value) * swing**2)
        damping = np.array(
            [
                [p.bearing_damping, 0.0, 0.0],
                [0.0, lossy, -lossy],
                [0.0, -lossy, lossy + (lost + viscous) / square],
            ]
        )
        system = np.block(
            [
                [np.zeros((3, 3)), np.eye(3)],
                [-stiffness / masses[:, None], -damping / masses[:, None]],
            ]
        )
        values = np.linalg.eigvals(system)
        swinging = values[values.imag > 0.0]
        value = complex(swinging[np.argmin(np.abs(swinging))])
    return value


def _motor(motor: ServoMotor, condition: Condition) -> dict[str, object]:
    """The motor's own friction and cogging."""
    on = condition.deviations.motor_friction
    return {
        "coulomb": motor.coulomb_friction if on else 0.0,
        "viscous": motor.viscous_friction if on else 0.0,
        "rotor_inertia": motor.rotor_inertia,
        "cogging": _orders(condition.deviations.cogging),
        "torque_constant_error": condition.deviations.torque_constant_error,
    }


def _torque_port(condition: Condition) -> dict[str, float]:
    """The torque port: reading = (1 + scale_error) true torque + offset."""
    port, extra = condition.torque_port, condition.deviations
    return {
        "offset": port.offset,
        "scale_error": (1.0 + port.gain_error) / (1.0 + extra.torque_constant_error) - 1.0,
        "gain_error": port.gain_error,
        "drift_per_kelvin": port.drift_per_kelvin,
        "noise": port.noise,
        "lag": extra.port_lag,
    }


def _error_at_mark(errors: EncoderErrors) -> float:
    """What the encoder shows more than the true angle where its index mark stands [rad]."""
    waves = errors.series if errors.subdivision is None else (*errors.series, errors.subdivision)
    return float(series_value(waves, errors.index_angle))


def _encoders(
    instruments: Instruments, condition: Condition, output_sense: int
) -> dict[str, object]:
    """Each encoder's errors over its own absolute angle, and where its counter stands."""
    instruments_truth: dict[str, object] = {
        which: {
            "orders": _orders(errors.series),
            "subdivision": _amplitude(errors.subdivision),
            "quantum": encoder.quantum,
            "angle_offset": encoder.angle_offset,
            "index_angle": encoder.index_angle,
            "index_error": _error_at_mark(errors),
        }
        for which, encoder, errors in (
            ("input", instruments.input, condition.input_encoder),
            ("output", instruments.output, condition.output_encoder),
        )
    }
    instruments_truth["output_sense"] = output_sense
    return instruments_truth
