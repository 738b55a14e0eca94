"""A table that takes the kinematic error out of the motion: what the input turns besides the nominal angle.

(15) ke = theta_o - theta_i/N,   ke(theta_i) = sum over v of a_v cos v theta_i + b_v sin v theta_i,   v = n + m/N

An input that is nominally at phi is sent to theta, so that the output is at phi/N:

    theta = phi - N ke(theta)          phi = theta + N ke(theta)          c(phi) = theta - phi

The angles count from the index marks: the mark of the input that is chosen by the mark of the output. One direction of
turning has its own series, because what friction winds up changes sign with the direction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from model.angle_certificate import CREST
from model.arrays import ComplexArray, FloatArray
from model.errors import ModelError
from model.gear import HarmonicDrive, Mounting
from model.kinematic_error import lattice_label, order_of_label, output_sign
from model.units import ARCSEC, REVOLUTION

_ROUNDS = 4
"""Of the fixed point theta = phi - N ke(theta), which gains two digits each: N ke' is some hundredths."""
_PER_WAVE = 64
"""Points of the fastest order at which peaks are looked for: between two of them it rises by a thousandth."""
_WHOLE = 1e-9
_STEEPEST = 0.3
"""N ke' above which the fixed point is none that anybody should drive by."""


@dataclass(frozen=True, kw_only=True)
class DirectionTable:
    """The kinematic error in one direction of turning, order by order.

    `labels` name the orders (cycles per input revolution: "2", "1/N", "2-1/N"); cosine, sine [rad at the output];
    `covariance` of each order's (cosine, sine): cc, cs, ss [rad2], type A with `freedom`; `encoder`: what the encoders
    that measured it may have added to a cosine or a sine, standard uncertainty [rad]; `rest`: r.m.s. of the orders that
    its runs show above their noise and the table leaves [rad].
    """

    labels: tuple[str, ...]
    cosine: tuple[float, ...]
    sine: tuple[float, ...]
    covariance: tuple[tuple[float, float, float], ...]
    encoder: tuple[float, ...]
    freedom: float
    rest: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Proof:
    """What a run with the table showed: which run, its verdict, remainder over prediction with its interval, the share
    of the error that was taken out, and between which input speeds the table begins to harm [rad/s]; the lower one is
    the fastest at which it helped, the upper is None where none harmed.
    """

    run: str
    verdict: str
    speed: float
    ratio: float
    low: float
    high: float
    removed: float
    helps_up_to: float | None
    harms_from: float | None


@dataclass(frozen=True, kw_only=True)
class CompensationTable:
    """What is taken out of the motion of one gear, and for which gear, mounting, bench, warmth and speeds it holds.

    `index_gap`: how far behind the preceding mark of the input the output's mark lies, in input revolutions, None where
    nobody noted it; `speed`:
    the input speeds of its runs [rad/s]; `temperature` of the housing [degC]; `runs`: each with its SHA-256; `learnt`:
    what corrected the output encoder.
    """

    gear: str
    part: str
    mounting: str
    ratio: float
    sense: int
    bench: str
    origin: str
    encoder: str
    learnt: str
    index_gap: float | None
    speed: tuple[float, float]
    temperature: float | None
    runs: tuple[str, ...]
    forward: DirectionTable
    reverse: DirectionTable
    proof: Proof | None = None

    def of(self, direction: float) -> Correction:
        """The correction for one direction of turning, by its sign."""
        return self._corrections[direction > 0.0]

    @property
    def encoder_rms(self) -> float:
        """R.m.s. of what the output encoder may have put into it [rad].

        A certificate's uncertainty is of any place of the curve, so of its r.m.s. over all places. A class bounds the
        largest value of the curve; the r.m.s. of a curve of several orders is that over its crest, not over sqrt 3.
        """
        ways = (self.forward, self.reverse)
        place = math.sqrt(0.5 * sum(u**2 for way in ways for u in way.encoder))
        return place if self.learnt else place * math.sqrt(3.0) / CREST

    @cached_property
    def _corrections(self) -> Mapping[bool, Correction]:
        return {
            ahead: Correction.of(one, self.ratio)
            for ahead, one in ((True, self.forward), (False, self.reverse))
        }


def table_of_set(gear: HarmonicDrive, mounting: Mounting) -> CompensationTable:
    """The series of a parameter set as a table, the same in both directions: what the set says of its gear, no more."""
    ratio = gear.mounted_ratio(mounting)
    series = gear.kinematic_error
    same = DirectionTable(
        labels=tuple(lattice_label(one.order, ratio) for one in series),
        cosine=tuple(one.cosine for one in series),
        sine=tuple(one.sine for one in series),
        covariance=((0.0, 0.0, 0.0),) * len(series),
        encoder=(0.0,) * len(series),
        freedom=1.0,
    )
    return CompensationTable(
        gear="",
        part=gear.name,
        mounting=mounting,
        ratio=ratio,
        sense=round(output_sign(mounting)),
        bench="",
        origin="",
        encoder="",
        learnt="",
        index_gap=None,
        speed=(0.0, 0.0),
        temperature=None,
        runs=(),
        forward=same,
        reverse=same,
    )


@dataclass(frozen=True, kw_only=True)
class Correction:
    """The series of one direction, ready to be driven by: complex orders a - i b [rad at the output], (v,)."""

    ratio: float
    orders: FloatArray = field(compare=False)
    waves: ComplexArray = field(compare=False)
    key: tuple[object, ...]
    """What two of them are told apart by."""

    @classmethod
    def of(cls, table: DirectionTable, ratio: float) -> Correction:
        """Raises `ModelError` for a series so steep that the input would stand or turn back."""
        orders = np.array([order_of_label(label, ratio) for label in table.labels])
        waves = np.array(table.cosine) - 1j * np.array(table.sine)
        steepest = ratio * float(np.sum(orders * np.abs(waves)))
        if steepest > _STEEPEST:
            raise ModelError(
                "would change the input's speed by more than a table may",
                where="compensation table",
                value=f"{100.0 * steepest:.0f} % of the speed",
                limit=f"<= {100.0 * _STEEPEST:.0f} %",
                remedy="Is it in radians at the output, and for this ratio?",
            )
        return cls(ratio=ratio, orders=orders, waves=waves, key=(ratio, table))

    def error(self, theta: FloatArray) -> FloatArray:
        """ke(theta) [rad at the output] at input angles (n,)."""
        total = np.zeros_like(theta)
        # Order by order: the arrays stay as long as the angles, and so does the last bit of every sine.
        for order, wave in zip(self.orders, self.waves, strict=True):
            total += wave.real * np.cos(order * theta) - wave.imag * np.sin(order * theta)
        return total

    def nominal(self, theta: FloatArray) -> FloatArray:
        """phi = theta + N ke(theta): the nominal angle of an input that is at theta [rad]."""
        return theta + self.ratio * self.error(theta)

    def corrected(self, phi: FloatArray) -> FloatArray:
        """theta, to which an input is sent that is nominally at phi [rad]."""
        theta = phi
        for _ in range(_ROUNDS):
            theta = phi - self.ratio * self.error(theta)
        return theta

    def added(self, phi: FloatArray) -> FloatArray:
        """c(phi) = theta - phi [rad of the input]."""
        return self.corrected(phi) - phi

    def turn(self, points: int) -> FloatArray:
        """Nominal angles (points,) over one output revolution [rad of the input]."""
        return np.linspace(0.0, REVOLUTION * self.ratio, points, endpoint=False)

    @cached_property
    def steepness(self) -> tuple[float, float]:
        """The largest |dc/dphi| and |d2c/dphi2| over an output revolution: peaks of speed and of acceleration.

        dc/dphi = -N ke'/(1 + N ke'),   d2c/dphi2 = -N ke''/(1 + N ke')^3   at theta
        """
        highest = max(float(self.orders.max(initial=1.0)), 1.0)
        theta = self.turn(round(_PER_WAVE * highest * self.ratio))
        slope, bend = np.zeros_like(theta), np.zeros_like(theta)
        for order, wave in zip(self.orders, self.waves, strict=True):
            cosine, sine = np.cos(order * theta), np.sin(order * theta)
            slope -= order * (wave.real * sine + wave.imag * cosine)
            bend -= order**2 * (wave.real * cosine - wave.imag * sine)
        stretched = 1.0 + self.ratio * slope
        first = np.abs(self.ratio * slope / stretched)
        second = np.abs(self.ratio * bend / stretched**3)
        return float(first.max()), float(second.max())

    @cached_property
    def largest(self) -> float:
        """The largest |c| over an output revolution [rad of the input]."""
        return float(np.abs(self.added(self.turn(4096))).max())

    @property
    def counts_from_output(self) -> bool:
        """Whether it has orders that are not whole, so that the output's index mark must say where they begin."""
        return bool(np.any(np.abs(self.orders - np.rint(self.orders)) > _WHOLE))

    @property
    def rms(self) -> float:
        """Root mean square of what it takes out [rad at the output]."""
        return float(np.sqrt(0.5 * np.sum(np.abs(self.waves) ** 2)))

    def in_words(self) -> str:
        """How large it is."""
        return f"{len(self.orders)} orders, {self.rms / ARCSEC:.3g} arcsec r.m.s."
