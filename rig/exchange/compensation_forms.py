"""A proved compensation table for other people's drives: CSV, JSON, and Fourier triples, over the nominal output angle.

    c(phi) = theta - phi        what is added to the nominal input angle, at the input [arcsec]

    csv       angle, forward, reverse: one row for each angle of an output turn
    json      the same, with what it is of as an object
    fourier   cycles per output turn, cosine, sine, for each direction: c = sum of a cos(k x) + b sin(k x)

Each names unit, sign, reference mark, direction, and the speed up to which it was seen to help; each reads back.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from model.arrays import FloatArray
from model.compensation import CompensationTable
from model.units import ARCSEC, DEGREE, RPM
from rig.errors import ConfigurationError

FORMAT: Final = "harmonic-rig-correction-1"
_PER_WAVE = 24
"""Points of the fastest order: what lies between two of them is linear to 1 % of it."""
_LEAST_WAVE = 0.01 * ARCSEC
"""rad at the output; waves of c below it are no part of the triples."""
WAYS = ("forward", "reverse")


@dataclass(frozen=True)
class CorrectionForm:
    """A correction as a drive takes it: what it is of, output angles (n,) [rad], and c (n,) each way [rad of the
    input].
    """

    facts: Mapping[str, Any]
    angle: FloatArray
    correction: Mapping[str, FloatArray]


def refuse_unproved(table: CompensationTable) -> None:
    """Raise `ConfigurationError` for a table of which nobody has shown that it helps."""
    proof = table.proof
    if proof is None or proof.verdict != "PASS" or proof.helps_up_to is None:
        told = "no proof" if proof is None else f"{proof.verdict}, by {proof.run}"
        raise ConfigurationError(
            "is not proved, and not exported",
            where=f"table of gear {table.gear}",
            value=told,
            limit="PASS",
            remedy="Run compensated-error with it, then: rig compensate THAT_RUN --output FILE.",
        )


def facts_of(table: CompensationTable) -> dict[str, Any]:
    """What every form says of itself."""
    refuse_unproved(table)
    assert table.proof is not None
    assert table.proof.helps_up_to is not None
    return {
        "format": FORMAT,
        "gear": table.gear,
        "mounting": table.mounting,
        "bench": table.bench,
        "ratio": table.ratio,
        "adds_to": "the nominal input angle, so that the output is at the nominal angle over the ratio",
        "sign": "positive in the direction in which the motor encoder counts up",
        "unit": "arcsec of the input",
        "angle": "nominal input angle over the ratio, degrees of the output",
        "zero": "the motor encoder's index mark "
        f"{table.index_gap:.4f} input revolutions before the output encoder's",
        "directions": "forward: the motor encoder counts up; reverse: it counts down",
        "helps_up_to_rpm": table.proof.helps_up_to / RPM,
        "proved_by": table.proof.run,
        "verdict": table.proof.verdict,
    }


def form_of(table: CompensationTable) -> CorrectionForm:
    """The correction of a proved table, point by point. Raises `ConfigurationError` for one that is not proved."""
    facts = facts_of(table)
    highest = max(float(table.of(way).orders.max(initial=1.0)) for way in (1.0, -1.0))
    points = math.ceil(_PER_WAVE * max(highest, 1.0)) * math.ceil(table.ratio)
    phi = table.of(1.0).turn(points)
    curves = {name: table.of(way).added(phi) for name, way in zip(WAYS, (1.0, -1.0), strict=True)}
    return CorrectionForm(facts, phi / table.ratio, curves)


def csv_text(table: CompensationTable) -> str:
    """The points as CSV, what they are of in lines with # before them."""
    form = form_of(table)
    lines = [f"# {name}: {value}" for name, value in form.facts.items()]
    lines.append("output_angle_deg,forward_arcsec,reverse_arcsec")
    columns = [form.angle / DEGREE, *(form.correction[way] / ARCSEC for way in WAYS)]
    lines += [f"{a:.6f},{b:.4f},{c:.4f}" for a, b, c in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"


def json_text(table: CompensationTable) -> str:
    """The points as one JSON object."""
    form = form_of(table)
    points = {"output_angle_deg": np.round(form.angle / DEGREE, 6).tolist()}
    points |= {f"{w}_arcsec": np.round(form.correction[w] / ARCSEC, 4).tolist() for w in WAYS}
    return json.dumps({**form.facts, **points}, indent=1, ensure_ascii=False) + "\n"


def fourier_text(table: CompensationTable) -> str:
    """The waves of the correction as CSV: direction, cycles per output turn, cosine, sine."""
    form = form_of(table)
    lines = [f"# {name}: {value}" for name, value in form.facts.items()]
    lines.append("direction,cycles_per_output_turn,cosine_arcsec,sine_arcsec")
    for way in WAYS:
        curve = form.correction[way]
        waves = np.fft.rfft(curve) / len(curve) * 2.0
        waves[0] *= 0.5
        for cycles in np.flatnonzero(np.abs(waves) > table.ratio * _LEAST_WAVE):
            wave = waves[cycles] / ARCSEC
            lines.append(f"{way},{cycles},{wave.real:.5f},{-wave.imag:.5f}")
    return "\n".join(lines) + "\n"


FORMS: Mapping[str, Callable[[CompensationTable], str]] = {
    "csv": csv_text,
    "json": json_text,
    "fourier": fourier_text,
}
"""How a correction is written, by the word of `--to`."""
