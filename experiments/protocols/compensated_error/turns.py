"""The traverses of a compensated-error run: orders of the output's deviation and of the motor's, over the nominal
angle.

The input was sent along theta = sum of the set speeds, as they were recorded; its nominal angle is

    phi = theta                 without the table
    phi = theta + N ke(theta)   with it

A constant and a steady drift between theta and what the motor encoder counts (lag, clocks, rounding) are taken off.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.angle.certified import CertifiedAngle, angle_of
from experiments.angle.phase_reference import PhaseReference
from experiments.evidence import usable
from experiments.recording import Recording, Segment
from model.arrays import ComplexArray, FloatArray
from model.compensation import CompensationTable, DirectionTable
from model.identify.angle_fit import AngleFit, solve_angle
from model.identify.angle_regression import AngleRegression, Basis, standard_basis
from model.identify.remainder import HYSTERESIS, REPRODUCED, OrdersLeft
from model.identify.torsion import Spring
from model.kinematic_error import order_of_label

HIGHEST_ORDER = 12
APART = 0.9
"""Cycles per output turn by which two orders must differ to be told apart."""


@dataclass(frozen=True, kw_only=True)
class Turn:
    """One traverse: nominal speed [rad/s, signed], with the table or without it, and its two fits [rad]."""

    speed: float
    repeat: int
    is_compensated: bool
    output: AngleFit
    motor: AngleFit


def basis_of(table: CompensationTable) -> Basis:
    """The orders that are looked for: those of every kinematic error, and those of the table."""
    standard = standard_basis(table.ratio, HIGHEST_ORDER)
    known = np.array(standard.orders)
    more: dict[str, float] = {}
    for label in dict.fromkeys((*table.forward.labels, *table.reverse.labels)):
        order = order_of_label(label, table.ratio)
        # One output turn cannot tell it from a neighbour: what it leaves is seen there.
        if np.abs(known - order).min() > APART / table.ratio:
            more[label] = order
    return (
        standard.united(Basis(table.ratio, tuple(more.values()), tuple(more))) if more else standard
    )


def turns_of(
    recording: Recording,
    table: CompensationTable,
    reference: PhaseReference,
    certified: dict[str, CertifiedAngle],
) -> Iterator[Turn]:
    """Every whole traverse, fitted."""
    basis = basis_of(table)
    for segment in recording.labelled("traverse", "compensated"):
        yield _turn(recording, table, reference.input_angle, certified, segment, basis)


def _turn(
    recording: Recording,
    table: CompensationTable,
    zero: float,
    certified: dict[str, CertifiedAngle],
    segment: Segment,
    basis: Basis,
) -> Turn:
    rows = slice(segment.start, segment.stop)
    # The motor encoder is what the drive follows: its own errors are part of where the table sends it.
    motor = recording.si("input_angle", rows) - zero
    speed = recording.si("target_speed", rows)
    output = recording.metadata.output_sense * angle_of(recording, "output_angle", rows, certified)
    sent = sent_to(speed, 1.0 / recording.metadata.sample_rate, motor)
    good = usable(recording, rows)
    return fitted(segment, table, basis, sent[good], output[good], motor[good])


def fitted(
    segment: Segment,
    table: CompensationTable,
    basis: Basis,
    theta: FloatArray,
    output: FloatArray,
    motor: FloatArray,
) -> Turn:
    """The orders of one traverse: where the input was sent, where output and motor were (n,) [rad]."""
    is_compensated = segment.label == "compensated"
    phi = table.of(segment.direction).nominal(theta) if is_compensated else theta
    sums = AngleRegression(table.ratio, 2)
    sums.add(phi, output - phi / table.ratio, motor - theta)
    cells = sums.cells()
    fits = [solve_angle(cells, basis, value=value)[0] for value in (0, 1)]
    return Turn(
        speed=segment.setpoint,
        repeat=segment.repeat,
        is_compensated=is_compensated,
        output=fits[0],
        motor=fits[1],
    )


def sent_to(speed: FloatArray, period: float, motor: FloatArray) -> FloatArray:
    """Where the input was sent (n,) [rad], laid on what the motor encoder counts by a constant and a drift."""
    theta = period * np.concatenate([[0.0], np.cumsum(speed[:-1])])
    along = np.linspace(-1.0, 1.0, len(theta))
    off = motor - theta
    slope = float(along @ (off - off.mean()) / (along @ along))
    return theta + off.mean() + slope * along


def orders_left(turns: list[Turn], table: CompensationTable, spring: Spring) -> OrdersLeft:
    """One direction at one speed with the table, of all its repeats."""
    way = table.forward if turns[0].speed > 0.0 else table.reverse
    orders = turns[0].output.basis.orders
    blocks = {
        label: block[0] + block[2] for label, block in zip(way.labels, way.covariance, strict=True)
    }
    own = _in_basis(orders, way, table.ratio, blocks)
    ahead, back = (
        _in_basis(orders, one, table.ratio, dict(zip(one.labels, waves(one), strict=True)))
        for one in (table.forward, table.reverse)
    )
    count = len(turns)
    passed_on = spring.response(np.array(orders) * turns[0].speed)
    deviation = np.mean([waves_of(turn.motor) for turn in turns], axis=0) / table.ratio
    unknown = spring.relative_uncertainty * np.abs((passed_on - 1.0) * deviation)
    wound_up = HYSTERESIS * np.abs(0.5 * (ahead - back))
    anew = REPRODUCED * np.abs(ahead if turns[0].speed > 0.0 else back)
    return OrdersLeft(
        remainder=np.mean([waves_of(turn.output) for turn in turns], axis=0),
        variance=np.mean([traces_of(turn.output) for turn in turns], axis=0) / count,
        freedom=turns[0].output.freedom * count,
        motor=passed_on * deviation,
        table=own.real,
        table_freedom=way.freedom,
        bench=np.asarray(unknown**2 + wound_up**2 + anew**2, dtype=np.float64),
        rest=way.rest,
    )


def waves(way: DirectionTable) -> list[complex]:
    """Complex orders a - i b of a table's direction."""
    return [complex(a, -b) for a, b in zip(way.cosine, way.sine, strict=True)]


def _in_basis(
    orders: Sequence[float], way: DirectionTable, ratio: float, values: Mapping[str, complex]
) -> ComplexArray:
    """Values by label as they stand in a basis (v,); zero where the table has none."""
    there = {round(order_of_label(label, ratio) * 1e9): values[label] for label in way.labels}
    return np.array([there.get(round(order * 1e9), 0.0) for order in orders], dtype=np.complex128)


def waves_of(fit: AngleFit) -> ComplexArray:
    """Complex orders a - i b (v,)."""
    return np.asarray(fit.values[2::2] - 1j * fit.values[3::2], dtype=np.complex128)


def traces_of(fit: AngleFit) -> FloatArray:
    """Variance of each complex order (v,): that of its cosine and of its sine."""
    own = np.diag(fit.covariance)
    return np.asarray(own[2::2] + own[3::2], dtype=np.float64)
