"""What hours do to a simulated gear: rates that its seed draws, each from a stream of its own, and what they have made.

    per 1000 h              law              drawn
    Coulomb friction F_c    1 + rate hours   uniform, -20 to +30 %; static friction keeps its proportion to it
    Stribeck velocity v_s   1 + rate hours   uniform, -20 to +20 %
    order 2 of the error    1 + rate hours   log-uniform, +2 to +50 %
    first stiffness K1      1 - rate hours   log-uniform, -1 to -15 %; K2 and K3 stay
    backlash                rate hours       log-uniform, 0.05 to 0.5 arcmin from end to end

A new gear has none of it. The card stays that of the new gear.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from model.gear import HarmonicDrive
from model.units import ARCMIN
from sim_backend.streams import stream
from sim_backend.world import World

_THOUSAND_HOURS = 1000.0
_WORN_ORDER = 2.0


@dataclass(frozen=True, kw_only=True)
class Wear:
    """Hours that a gear has run, and its rates: relative changes per 1000 h, of the backlash rad per 1000 h."""

    hours: float
    coulomb_rate: float
    stribeck_velocity_rate: float
    order_2_rate: float
    stiffness_rate: float
    backlash_rate: float

    @classmethod
    def of(cls, world: World) -> Wear:
        """The wear of the gear of a world."""

        def within(name: str, low: float, high: float) -> float:
            return float(stream(world.gear_seed, f"wear {name}").uniform(low, high))

        def log_within(name: str, low: float, high: float) -> float:
            return math.exp(within(name, math.log(low), math.log(high)))

        return cls(
            hours=world.hours,
            coulomb_rate=within("coulomb", -0.20, 0.30),
            stribeck_velocity_rate=within("stribeck velocity", -0.20, 0.20),
            order_2_rate=log_within("order 2", 0.02, 0.50),
            stiffness_rate=-log_within("stiffness", 0.01, 0.15),
            backlash_rate=log_within("backlash", 0.05 * ARCMIN, 0.5 * ARCMIN),
        )

    def factor(self, rate: float) -> float:
        """What a relative rate has made of a parameter by now."""
        return 1.0 + rate * self.hours / _THOUSAND_HOURS

    @property
    def backlash(self) -> float:
        """Play of the torsion from end to end [rad]."""
        return self.backlash_rate * self.hours / _THOUSAND_HOURS

    def worn(self, gear: HarmonicDrive) -> HarmonicDrive:
        """The gear after its hours; its backlash is no parameter of it.

        Young's modulus and the loads of a tooth pair and of the bearing make cup, mesh and bearing softer by exactly
        one factor. The proportions K2/K1 and K3/K1 grow by as much, so that the later springs stay.
        """
        if not self.hours:
            return gear
        dry, softer = self.factor(self.coulomb_rate), self.factor(self.stiffness_rate)
        factors = {
            "mesh_friction.coulomb": dry,
            "mesh_friction.static": dry,
            "mesh_friction.stribeck_velocity": self.factor(self.stribeck_velocity_rate),
            "material.youngs_modulus": softer,
            "tooth.pair_load": softer,
            "bearing.radial_load": softer,
            "ratings.stiffness_1": softer,
        }
        grown = {_WORN_ORDER: self.factor(self.order_2_rate)}
        by_order = [(h, grown.get(h.order, 1.0)) for h in gear.kinematic_error]
        series = tuple(
            dataclasses.replace(h, cosine=by * h.cosine, sine=by * h.sine) for h, by in by_order
        )
        changed = {path: factor * gear.value(path).value for path, factor in factors.items()}
        return dataclasses.replace(gear.with_values(changed), kinematic_error=series)
