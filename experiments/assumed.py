"""What is assumed where nobody says it: one table for encoders, torque, current, temperature, time, inertia, bearing.

A value that was not given is not zero. Imports, `rig.toml` and gear cards that leave one away get the line of its kind
from here: it stands in budgets as assumed, with what replaces it. Whoever states 0 is believed. A number that rests on
assumed lines for more than half of its U^2 is at most "weakly" (`rests_on`, `experiments.evidence.conclusion`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from model.channel import Channel
from model.identify.distribution import Distribution
from model.identify.estimate import BudgetLine, Cause, Estimate
from model.units import ARCMIN, ARCSEC, REVOLUTION

LARGEST_SHARE = 0.5
"""Share of U^2 that may rest on assumed lines in a number that is called identified."""


@dataclass(frozen=True, kw_only=True)
class Assumed:
    """The line of one kind of value that nobody gave.

    `what` is meant by it, `bounds` says how large it is taken in words; `standard_uncertainty` in `unit` ("1":
    relative). `source` says where the size is from, `reason` why it is that one; `replaced_by` names the command or key
    with which the value is given.
    """

    kind: str
    what: str
    bounds: str
    standard_uncertainty: float
    unit: str
    distribution: Literal["rectangular", "normal"] = "rectangular"
    source: str
    reason: str
    replaced_by: str

    @property
    def half_width(self) -> float:
        """Half the width of the rectangular distribution [unit]."""
        return self.standard_uncertainty * math.sqrt(3.0)

    @property
    def note(self) -> str:
        """What a line of a budget says of itself."""
        return f"assumed: {self.bounds}. Give it: {self.replaced_by}"

    def line(self, source: str, size: float, cause: Cause | None = None) -> BudgetLine:
        """The line of a budget that is called `source`; `size` is its standard uncertainty in the estimate's unit."""
        line = BudgetLine(source, "B", abs(size), cause=cause)
        return self.marked(line)

    def marked(self, line: BudgetLine) -> BudgetLine:
        """A line that was computed elsewhere with this one's numbers, marked as assumed."""
        shape = Distribution(self.distribution)
        return replace(line, note=self.note, assumed=self.kind, distribution=shape)


def _within(half_width: float) -> float:
    """Standard uncertainty of what lies anywhere within half a width."""
    return half_width / math.sqrt(3.0)


OUTPUT_ENCODER = Assumed(
    kind="output encoder",
    what="half-width of its whole curve of errors over one revolution",
    bounds="its whole curve within 60 arcsec",
    standard_uncertainty=_within(60.0 * ARCSEC),
    unit="rad",
    source="data sheets of ring encoders and of encoders with a bearing of their own: 2 to 60 arcsec",
    reason="10 um of eccentricity on a scale of 110 mm are 37 arcsec alone; coarser ones are seldom put on an output",
    replaced_by="rig import --accuracy output_angle=5arcsec; [counter.calibration] accuracy in rig.toml",
)
MOTOR_ENCODER = Assumed(
    kind="motor encoder",
    what="half-width of its whole curve of errors over one revolution",
    bounds="its whole curve within 10 arcmin",
    standard_uncertainty=_within(10.0 * ARCMIN),
    unit="rad",
    source="data sheets of resolvers: 10 arcmin; of servo motors' encoders: 0.3 to 2 arcmin",
    reason="the coarsest that servo motors commonly have; the ratio divides it",
    replaced_by="rig import --accuracy input_angle=1arcmin; [motor_encoder.calibration] accuracy in rig.toml",
)
TORQUE_SCALE = Assumed(
    kind="torque scale",
    what="relative error of the scale of a torque or a force",
    bounds="within 5 %",
    standard_uncertainty=0.03,
    unit="1",
    source="motors' data sheets: tolerance of the torque constant 5 %, less when warm",
    reason="a torque that nobody calibrated is a current times that constant",
    replaced_by="scale_uncertainty in the map of an import; scale_relative_uncertainty in rig.toml",
)
CURRENT = Assumed(
    kind="current",
    what="relative error of the gain of a current, a voltage or of counts that stand for a torque",
    bounds="within 5 %",
    standard_uncertainty=0.03,
    unit="1",
    source="data sheets of servo amplifiers: 1 to 5 % of the current that they report",
    reason="without a shunt of its own nobody looked at it",
    replaced_by="scale_uncertainty in the map of an import",
)
TORQUE_ZERO = Assumed(
    kind="torque zero",
    what="offset of a torque, a force or a current, as a share of its largest value",
    bounds="within 2 % of the largest value",
    standard_uncertainty=_within(0.02),
    unit="1",
    source="analogue ports of servo amplifiers: 20 mV of some volts",
    reason="a zero that was never read with the servo off has drifted since it was set",
    replaced_by="segments with the servo off; offset_uncertainty in the map of an import or in rig.toml",
)
THERMOMETER = Assumed(
    kind="thermometer",
    what="error of a thermometer",
    bounds="within 1.5 K",
    standard_uncertainty=_within(1.5),
    unit="K",
    source="IEC 60584: thermocouples of class 1; resistors of class B are within 0.5 K",
    reason="a recording does not show of what kind it was, nor how it touched the housing",
    replaced_by="offset_uncertainty of housing_temperature in the map of an import or in rig.toml",
)
TEMPERATURE = Assumed(
    kind="temperature",
    what="temperature of a gear and its motor where none was recorded",
    bounds="20 °C, known to 5 K",
    standard_uncertainty=5.0,
    unit="K",
    distribution="normal",
    source="halls from 15 to 25 °C, and 5 to 20 K of own warmth",
    reason="most rigs stand in a hall and are run for minutes",
    replaced_by="record housing_temperature",
)
TIME_BASE = Assumed(
    kind="time base",
    what="relative error of a rate that the computer or the user says",
    bounds="rate within 0.5 %",
    standard_uncertainty=_within(0.005),
    unit="1",
    source="loops of computers without a real-time clock: 0.1 to 1 % beside the rate that was set",
    reason="rows were counted, not timed; a quartz would be within 1e-4",
    replaced_by="import the column of time stamps: --channel time=COLUMN:s",
)
ROTOR = Assumed(
    kind="rotor inertia",
    what="relative error of a rotor's inertia by its data sheet",
    bounds="its data sheet, within 10 %",
    standard_uncertainty=_within(0.10),
    unit="1",
    source="motors' data sheets: 10 %",
    reason="couplings and brakes are seldom counted",
    replaced_by="runs of torque-scale with a disc and without, which fit it: rig bench learn",
)
DISC = Assumed(
    kind="inertia of a disc",
    what="relative error of the inertia of a disc of which nobody says how well it is known",
    bounds="turned and weighed: 0.5 %, standard",
    standard_uncertainty=0.005,
    unit="1",
    distribution="normal",
    source="0.1 mm of 80 mm are 0.25 % of the inertia, a keyway or a grub screw as much",
    reason="mass and diameters are read, seldom their uncertainty",
    replaced_by="--inertia-uncertainty of the torque-scale run, k = 2",
)
LOWEST_MODE = 8.0 * REVOLUTION
"""rad/s; the lowest first torsional mode that is assumed of an output of which nobody says what it carries."""
OUTPUT_INERTIA = Assumed(
    kind="output inertia",
    what="square of the first torsional mode, inverse: from none to that of the lowest mode",
    bounds="first mode at 8 Hz or above",
    standard_uncertainty=_within(0.5 / LOWEST_MODE**2),
    unit="s2/rad2",
    source="arms of robots: 8 to 30 Hz; benches with a disc: 30 to 200 Hz",
    reason="another gear's load says nothing; what turns too fast for it is not judged",
    replaced_by="rig gear set SERIAL --load-inertia-kg-m2 VALUE; rig import --resonance-hz HZ",
)
BEARING = Assumed(
    kind="output bearing",
    what="friction of the bench's output bearing",
    bounds="0.1 to 1 N m at the output",
    # Root mean square of 0.1 to 1 N m: what is not subtracted stands in the budget in full.
    standard_uncertainty=math.sqrt((1.0 - 0.1**3) / (3.0 * 0.9)),
    unit="N m",
    source="bearing makers' formulas for sealed bearings of 60 to 120 mm",
    reason="no run with a gear can tell it from the gear's dry friction",
    replaced_by="[output_bearing] in rig.toml; --set output_bearing=VALUE,U of rig fit",
)
ONE_WAY = Assumed(
    kind="offset of a motion in one direction",
    what="what moves the axis both ways alike (gravity, a zero), as a share of the Coulomb friction beside it",
    bounds="within a fifth of the Coulomb friction",
    standard_uncertainty=_within(0.2),
    unit="1",
    source="recordings that reverse: EMPS 16 %, TIAGo arm, joint 1: 6 %",
    reason="in one direction it cannot be told from the friction",
    replaced_by="record a motion that reverses",
)

TABLE = (
    OUTPUT_ENCODER,
    MOTOR_ENCODER,
    TORQUE_SCALE,
    CURRENT,
    TORQUE_ZERO,
    THERMOMETER,
    TEMPERATURE,
    TIME_BASE,
    ROTOR,
    DISC,
    OUTPUT_INERTIA,
    BEARING,
    ONE_WAY,
)
"""Every kind of value that may be left away, with what is assumed in its place."""
ENCODERS = {"input_angle": MOTOR_ENCODER, "output_angle": OUTPUT_ENCODER}
"""What is assumed of the two angles, by channel."""


def half_width_of(channel: Channel) -> float:
    """Half the width of the curve of the encoder of "input_angle" or "output_angle" [rad]: stated, else assumed."""
    stated = channel.calibration.accuracy
    return ENCODERS[channel.name].half_width if stated is None else stated


def assumed_kinds(estimate: Estimate) -> tuple[str, ...]:
    """The kinds of assumed lines in a budget, the largest first."""
    lines = [line for line in estimate.budget if line.assumed and line.standard_uncertainty > 0.0]
    lines.sort(key=lambda line: -line.standard_uncertainty)
    return tuple(dict.fromkeys(line.assumed for line in lines))


def replacing(estimates: Iterable[Estimate]) -> dict[str, str]:
    """By kind of what numbers rest on although nobody said it: what states it."""
    kinds = dict.fromkeys(k for e in estimates if rests_on(e) for k in assumed_kinds(e)[:2])
    told = {row.kind: row.replaced_by for row in TABLE}
    return {kind: told[kind] for kind in kinds if kind in told}


def rests_on(estimate: Estimate) -> str:
    """What a number rests on for more than half of its U^2 although nobody said it, in words; "" where it does not."""
    whole = math.fsum(line.standard_uncertainty**2 for line in estimate.budget)
    assumed = math.fsum(line.standard_uncertainty**2 for line in estimate.budget if line.assumed)
    if not assumed > LARGEST_SHARE * whole:
        return ""
    return f"rests on an assumed {' and '.join(assumed_kinds(estimate)[:2])}"
