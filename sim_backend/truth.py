"""What only a simulated rig knows: every effective parameter, named as the estimates are, as plain JSON-able data.

Kinematic error: "orders" is the gear alone, "measurable" what the two counters can see, gear and
encoders together; both over the input angle from the index marks (the input's mark at or before the
output's). "measurable_recorded" is the same over the recorded input angle (counts times scale), to
be laid on a fit of raw counts without any shift. Friction holds at the reference temperature.
"""

from __future__ import annotations

import cmath
import dataclasses
import math
from collections.abc import Iterable

import numpy as np

from model import friction
from model.closed_loop import ClosedLoop
from model.gear import Harmonic
from model.kinematic_error import peak_to_peak
from model.motor import ServoMotor
from model.units import REVOLUTION, RPM
from sim_backend.imperfections import Condition, Imperfections
from sim_backend.sensors import Instruments
from sim_backend.world import World


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
    truth: dict[str, object] = {
        "imperfections": {name: bool(getattr(on, name)) for name in on.names()},
        "sizes": dataclasses.asdict(on.sizes),
        "world": dataclasses.asdict(world),
        "motor": _motor(motor, condition),
        "torque_port": _torque_port(condition),
        "encoders": _encoders(instruments, condition, output_sense),
        "thermal": dataclasses.asdict(condition.deviations.thermal)
        if condition.deviations.thermal
        else {},
        "thermometer": {"housing_offset": condition.housing_offset},
        "timing": {
            "sync_jitter": condition.sync_jitter,
            "input_skew": condition.input_encoder.skew,
            "output_skew": condition.output_encoder.skew,
            "skew": condition.output_encoder.skew - condition.input_encoder.skew,
        },
        "start_angle": condition.start_angle,
        "gear_mounted": mounted,
        "inertia": {
            "motor": motor.rotor_inertia,
            "disc": loop.settings.disc_inertia,
            "total_at_input": loop.inertia,
        },
    }
    if mounted:
        truth["friction"] = _friction(loop)
        truth["kinematic_error"] = _kinematic_error(loop, condition, instruments, output_sense)
        truth["dynamics"] = _dynamics(loop)
    return truth


def _friction(loop: ClosedLoop) -> dict[str, object]:
    """Friction of the gear, and what a fit of input torque can see of it: with the output
    bearing's, in the same units.
    """
    gear, extra = loop.gear, loop.deviations
    mesh = gear.mesh_friction
    lever = friction.mesh_lever(gear) * gear.ratio / loop.ratio
    coulomb = extra.output_coulomb / (loop.ratio * lever)
    viscous = extra.output_viscous / (loop.ratio**2 * lever)
    speed = np.array([1, 3, 10, 30, 60, 100, 200, 300, 600, 1000, 1500, 2000, 2500, 3000]) * RPM
    mesh_torque = lever * friction.stribeck_magnitude(mesh, speed)
    drag = friction.bearing_lever(gear) * np.abs(friction.bearing_friction_torque(gear, speed))
    output = extra.output_coulomb / loop.ratio + extra.output_viscous * speed / loop.ratio**2
    own = {
        "coulomb": mesh.coulomb,
        "static": mesh.static,
        "stribeck_velocity": mesh.stribeck_velocity,
        "shape": mesh.shape,
        "viscous": mesh.viscous,
    }
    return {
        **own,
        "torque_balance": gear.options.torque_balance,
        "bearing_friction_factor": gear.bearing.friction_factor,
        "viscosity": gear.bearing.viscosity,
        "mesh_depth": extra.mesh_depth,
        "output_bearing_coulomb": extra.output_coulomb,
        "output_bearing_viscous": extra.output_viscous,
        "measurable": {
            **own,
            "coulomb": mesh.coulomb + coulomb,
            "static": mesh.static + coulomb,
            "viscous": mesh.viscous + viscous,
        },
        "torque_curve": {
            "speed": speed.tolist(),
            "gear": (mesh_torque + drag).tolist(),
            "measurable": (mesh_torque + drag + output).tolist(),
        },
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
    summed: dict[float, complex] = {}
    for order, amplitude in seen:
        key = next((other for other in summed if abs(other - order) < 1e-9), order)
        summed[key] = summed.get(key, 0.0) + amplitude
    mark = _reference_mark(condition, ratio, output_sense)
    offset = instruments.input.angle_offset
    own = [
        _harmonic(order, value * cmath.exp(1j * order * mark))
        for order, value in map(_complex, loop.series)
    ]
    marked = [
        _harmonic(order, value * cmath.exp(1j * order * mark))
        for order, value in sorted(summed.items())
    ]
    recorded = [
        _harmonic(order, value * cmath.exp(-1j * order * offset))
        for order, value in sorted(summed.items())
    ]
    return {
        "orders": _orders(own),
        "measurable": _orders(marked),
        "measurable_recorded": _orders(recorded),
        "peak_to_peak": peak_to_peak(own, ratio, 120) if own else 0.0,
        "measurable_peak_to_peak": peak_to_peak(marked, ratio, 120) if marked else 0.0,
        "reference_angle": mark + offset,
        "input_subdivision": _amplitude(condition.input_encoder.subdivision),
        "output_subdivision": _amplitude(condition.output_encoder.subdivision),
    }


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


def _dynamics(loop: ClosedLoop) -> dict[str, object]:
    """Stiffness, inertia, damping and what hardens."""
    gear, extra, stiffness = loop.gear, loop.deviations, loop.parameters.combined_stiffness
    ratings = gear.ratings
    hard = extra.hardening
    return {
        "stiffness_over_inertia": loop.stiffness_over_inertia,
        "resonance": math.sqrt(loop.stiffness_over_inertia) / (2.0 * math.pi),
        "stiffness": loop.stiffness_over_inertia * gear.inertia.output,
        "output_inertia": gear.inertia.output,
        "radial_damping": gear.bearing.damping,
        "structural_damping": gear.damping.structural,
        "hardening": {
            "torque_1": ratings.torque_1,
            "torque_2": ratings.torque_2,
            "stiffness_2": stiffness * ratings.stiffness_2 / ratings.stiffness_1,
            "stiffness_3": stiffness * ratings.stiffness_3 / ratings.stiffness_1,
        }
        if hard
        else {},
        "hysteresis": {
            "torque": extra.hysteresis_torque,
            "stiffness_share": extra.hysteresis_stiffness,
        }
        if extra.hysteresis_torque
        else {},
        "ratio": loop.ratio,
    }


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
        }
        for which, encoder, errors in (
            ("input", instruments.input, condition.input_encoder),
            ("output", instruments.output, condition.output_encoder),
        )
    }
    instruments_truth["output_sense"] = output_sense
    return instruments_truth
