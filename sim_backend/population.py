"""Which gears and benches there are: like the nominal one, or as different as an analysis has to bear.

`drawn` makes of a card and a world the gear and the motor that are simulated, the cards that plan
and analysis get, and what the bench has. Everything is drawn independently, each entry from a
stream of its own, named as in `_Draw`; uniform where no law is said.

narrow      parts of one series: `individual_gear` and `individual_motor` about the card, the rotor's inertia
            within 10 % of it; the bench as `sim_backend.drawing` draws it about its sizes. The card is the
            nominal one.

wide        gear, from the gear's seed
  J_o                       0.02 to 1 kg m2, log-uniform
  N                         one of 50, 80, 100, 120, 160; Z_f = 2 N, Z_c = 2 N + 2
  F_c                       20 to 150 N, log-uniform
  F_s/F_c                   0.9 to 1.8, log-uniform
  v_s, shape, c_v           0.3 to 10 rad/s; 0.5 to 2; 0.05 to 0.6 N s/rad
  temperature of friction   viscous -0.5 to -4 % per kelvin (as an exponential), dry 0 to -1 % per kelvin;
                            the parameters above hold at 20 degC
  stiffness                 K_t, K_b and K_m times one factor of 0.6 to 1.4; K2/K1 1.2 to 2, K3/K2 1 to 1.3
                            above the card's T1 and T2
  hysteresis (Dahl)         0.2 to 2 arcmin of loss: T_h = K_HDf loss/2 (a loop in which the element slides is
                            that wide where the torque is zero), initial stiffness T_h over a travel of 3 arcmin
  kinematic error           orders n = 1 to 6, sidebands n - 1/N and n + 1/N of each, and 2 - 2/N, 2 + 2/N:
                            amplitude 0.2 to 20 arcsec, log-uniform, any phase
  output orders             k/N, k = 1 to 8: amplitude 0.2 to 3 arcsec, log-uniform, any phase
            bench, from the bench's seed
  output encoder            orders 1 to 8, any phases, shares uniform, and orders 9 to 64 likewise, which have 5 to 20 %
                            of the whole curve's half width; that ((largest - smallest)/2) is scaled to 0.5 to 1 of
                            the class of 5 arcsec; subdivision 1 % of a line
  motor encoder             orders 1, 2, 4 likewise in a class of 30 arcsec; subdivision 1 % of a line
  torque port               gain +-1 %, lag 0 to 2 ms
  output bearing            0.1 to 1 N m of Coulomb friction, 0 to -1 % per kelvin from 20 degC
  skew                      the output is latched 0 to 1 ms after the input
  motor                     torque constant +-2 %, Coulomb and viscous friction +-50 % each, cogging 0 to 5 mN m
                            (its largest order; the others in the nominal proportion, any phases); inertia of
                            the rotor +-10 %
  clock                     +-50 ppm, as of a narrow bench
  correlation of days       0 to 0.4
            day, from the day's seed
  torque port               zero +-5 mN m
  ambient                   15 to 32 degC, where gear and motor start

The wide card is the drawn gear's nameplate: N with matching teeth, and module, deformation and
teeth in the proportion of the nominal gear, exact; J_o within 3 % of the drawn one; ratings of the
size at that ratio. All else on it is nominal. What hours do to either gear says `sim_backend.wear`.
"""

from __future__ import annotations

import dataclasses
import math
import re
from dataclasses import dataclass

import numpy as np

from model.closed_loop import Deviations, Thermal
from model.gear import Harmonic, HarmonicDrive, Origin
from model.kinematic_error import series_value
from model.motor import ServoMotor
from model.stiffness import drive_stiffness
from model.units import ARCMIN, ARCSEC, REVOLUTION
from sim_backend.condition import EncoderErrors, Sideband, Stated, TorquePort
from sim_backend.days import Days
from sim_backend.drawing import half_width
from sim_backend.imperfections import Sizes
from sim_backend.individuals import individual_gear, individual_motor
from sim_backend.streams import stream
from sim_backend.world import World

_RATIOS = (50, 80, 100, 120, 160)
OUTPUT_CLASS, INPUT_CLASS = 5.0 * ARCSEC, 30.0 * ARCSEC
"""Classes of the wide bench's encoders: half width of the whole curve over one revolution [rad]."""
_DAHL_TRAVEL = 3.0 * ARCMIN
"""Torsion over which the hysteresis element of a wide gear would slide at its initial stiffness [rad]."""
REFERENCE = 20.0
"""degC at which drawn friction holds."""
OUTPUT_ORDERS = range(1, 9)
"""Of the output, k of k/N, that a wide gear has."""
FINE_ORDERS = range(9, 65)
"""Of its own revolution that a wide bench's output encoder has beside 1 to 8."""
FINE_SHARE = (0.05, 0.20)
"""Of the whole curve's half width that they have."""
ROTOR = 0.10
"""How far a rotor's inertia may be from its card, as a share."""

_RATINGS = {
    50: (39.0, 98.0, 186.0, 2.5e4, 3.4e4, 4.4e4, 0.15, 55.0, 450.0),
    80: (63.0, 137.0, 255.0, 3.1e4, 5.0e4, 5.7e4, 0.114, 87.0, 680.0),
    100: (67.0, 157.0, 284.0, 3.1e4, 5.0e4, 5.7e4, 0.100, 108.0, 500.0),
    120: (67.0, 167.0, 304.0, 3.1e4, 5.0e4, 5.7e4, 0.090, 108.0, 470.0),
    160: (67.0, 176.0, 314.0, 3.1e4, 5.0e4, 5.7e4, 0.076, 108.0, 450.0),
}
"""By ratio, size 25 of the catalogue: rated, repeated and momentary peak torque [N m], K1, K2, K3
[N m/rad]; starting torque [N m] between the two ratios for which one is stated, as a power of N; limit of the
average torque and torque of ratcheting [N m]."""
_RATED = (
    "rated_torque",
    "repeated_peak_torque",
    "momentary_peak_torque",
    "stiffness_1",
    "stiffness_2",
    "stiffness_3",
    "starting_torque",
    "average_torque_limit",
    "ratcheting_torque",
)


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A simulated world's parts: `gear` and `motor` are the truth, `card` and `motor_card` what plan and analysis get.

    `sizes` is what the bench's own imperfections are drawn about, with `stated` where they stand as they are.
    """

    gear: HarmonicDrive
    card: HarmonicDrive
    motor: ServoMotor
    motor_card: ServoMotor
    sizes: Sizes


def drawn(card_of: HarmonicDrive, motor: ServoMotor, world: World) -> Drawn:
    """Gear, motor and bench of a world, about these nominal ones (see the table at the top)."""
    if world.population == "narrow":
        return Drawn(
            gear=individual_gear(card_of, world.gear_seed),
            card=card_of,
            motor=_with_rotor(individual_motor(motor, world.bench_seed), world),
            motor_card=motor,
            sizes=Sizes(),
        )
    gear, bench = _Draw(world.gear_seed), _Draw(world.bench_seed)
    own_motor = dataclasses.replace(
        motor,
        coulomb_friction=motor.coulomb_friction * bench.within("motor coulomb", 0.5, 1.5),
        viscous_friction=motor.viscous_friction * bench.within("motor viscous", 0.5, 1.5),
    )
    card = _card(card_of, gear)
    own = _gear(card, gear)
    return Drawn(
        gear=own,
        card=card,
        motor=_with_rotor(own_motor, world),
        motor_card=motor,
        sizes=_sizes(own, gear, bench, world),
    )


def _with_rotor(motor: ServoMotor, world: World) -> ServoMotor:
    """The motor with a rotor of its own."""
    if world.version < 2:
        return motor
    away = float(stream(world.bench_seed, "rotor inertia").uniform(-ROTOR, ROTOR))
    return dataclasses.replace(motor, rotor_inertia=motor.rotor_inertia * (1.0 + away))


@dataclass(frozen=True)
class _Draw:
    """The wide draws of one seed, each entry from the stream of its name."""

    seed: int

    def of(self, entry: str) -> np.random.Generator:
        return stream(self.seed, f"wide {entry}")

    def within(self, entry: str, low: float, high: float) -> float:
        return float(self.of(entry).uniform(low, high))

    def log_within(self, entry: str, low: float, high: float) -> float:
        return math.exp(self.within(entry, math.log(low), math.log(high)))

    def wave(self, entry: str, low: float, high: float) -> complex:
        """Cosine and sine of a wave with a log-uniform amplitude at any phase, from one stream."""
        random = self.of(entry)
        amplitude = math.exp(random.uniform(math.log(low), math.log(high)))
        phase = random.uniform(0.0, REVOLUTION)
        return complex(amplitude * math.cos(phase), amplitude * math.sin(phase))


def _output_inertia(gear: _Draw) -> float:
    return gear.log_within("output inertia", 0.02, 1.0)


def _card(nominal: HarmonicDrive, gear: _Draw) -> HarmonicDrive:
    """The nameplate of a wide gear: the nominal one at another ratio, with the inertia as a user would state it."""
    ratio = int(gear.of("ratio").choice(_RATIOS))
    geometry, tooth = nominal.geometry, nominal.tooth
    module = geometry.flexspline_diameter / (2 * ratio)
    finer = module / geometry.module
    changes = {
        "teeth.flexspline": 2 * ratio,
        "teeth.circular_spline": 2 * ratio + 2,
        "geometry.circular_spline_diameter": geometry.flexspline_diameter + 2.0 * module,
        "geometry.radial_deformation": geometry.radial_deformation * finer,
        "tooth.height": tooth.height * finer,
        "tooth.root_width": tooth.root_width * finer,
        "tooth.force_depth": tooth.force_depth * finer,
        "inertia.output": _output_inertia(gear)
        * (1.0 + gear.within("stated inertia", -0.03, 0.03)),
        **{f"ratings.{name}": v for name, v in zip(_RATED, _RATINGS[ratio], strict=True)},
    }
    card = nominal.with_values(changes, Origin("assumed", "nameplate of a simulated gear"))
    name = re.sub(rf"-{nominal.ratio:.0f}(?=-|$)", f"-{ratio}", nominal.name)
    return dataclasses.replace(card, name=name)


def _gear(card: HarmonicDrive, gear: _Draw) -> HarmonicDrive:
    """The truth behind a wide card.

    Young's modulus, the load of a tooth pair and that of the bearing times one factor make cup, mesh and bearing
    stiffer by exactly that factor: the deflections stay as they are.
    """
    factor = gear.within("stiffness", 0.6, 1.4)
    coulomb = gear.log_within("coulomb", 20.0, 150.0)
    second = factor * card.ratings.stiffness_1 * gear.within("second stiffness", 1.2, 2.0)
    changes = {
        "inertia.output": _output_inertia(gear),
        "material.youngs_modulus": factor * card.material.youngs_modulus,
        "tooth.pair_load": factor * card.tooth.pair_load,
        "bearing.radial_load": factor * card.bearing.radial_load,
        "ratings.stiffness_1": factor * card.ratings.stiffness_1,
        "ratings.stiffness_2": second,
        "ratings.stiffness_3": second * gear.within("third stiffness", 1.0, 1.3),
        "mesh_friction.coulomb": coulomb,
        "mesh_friction.static": coulomb * gear.log_within("static", 0.9, 1.8),
        "mesh_friction.stribeck_velocity": gear.within("stribeck velocity", 0.3, 10.0),
        "mesh_friction.shape": gear.within("shape", 0.5, 2.0),
        "mesh_friction.viscous": gear.within("viscous", 0.05, 0.6),
    }
    series: list[Harmonic] = []
    for n in range(1, 7):
        wave = gear.wave(f"order {n}", 0.2 * ARCSEC, 20.0 * ARCSEC)
        series.append(Harmonic(float(n), wave.real, wave.imag))
    own = card.with_values(changes, Origin("assumed", "drawn for the simulation"))
    return dataclasses.replace(own, kinematic_error=tuple(series))


def _sizes(own: HarmonicDrive, gear: _Draw, bench: _Draw, world: World) -> Sizes:
    """What channels say of the wide bench (its classes, as standard uncertainties), and what it has."""
    uniform = 1.0 / math.sqrt(3.0)
    return dataclasses.replace(
        Sizes(),
        input_accuracy=INPUT_CLASS,
        output_accuracy=OUTPUT_CLASS,
        torque_scale=0.01 * uniform,
        torque_constant=0.02 * uniform,
        torque_offset=5e-3 * uniform,
        stated=_wide_condition(own, gear, bench, world),
    )


def _wide_condition(own: HarmonicDrive, gear: _Draw, bench: _Draw, world: World) -> Stated:
    nominal, days, newer = Sizes(), Days(world), world.version >= 2
    ambient = days.within("wide ambient", 15.0, 32.0)
    hysteresis = 0.5 * gear.within("hysteresis", 0.2 * ARCMIN, 2.0 * ARCMIN)
    pairs = [(n, k) for n in range(1, 7) for k in (-1, 1)] + [(2, -2), (2, 2)]
    bands = [gear.wave(f"sideband {n} {k:+d}", 0.2 * ARCSEC, 20.0 * ARCSEC) for n, k in pairs]
    deviations = Deviations(
        friction_windup=True,
        mesh_depth=nominal.mesh_depth,
        hardening=True,
        hysteresis_torque=hysteresis * drive_stiffness(own).combined_output,
        hysteresis_stiffness=hysteresis / _DAHL_TRAVEL,
        output_coulomb=bench.within("output bearing", 0.1, 1.0),
        output_per_kelvin=bench.within("output bearing per kelvin", 0.0, 0.01),
        motor_friction=True,
        cogging=_cogging(bench, nominal.motor_cogging),
        torque_constant_error=bench.within("torque constant", -0.02, 0.02),
        port_lag=bench.within("torque lag", 0.0, 2e-3),
        thermal=Thermal(
            ambient=ambient,
            housing_start=ambient,
            motor_start=ambient,
            reference=REFERENCE,
            coulomb_per_kelvin=gear.within("dry per kelvin", 0.0, 0.01),
            viscous_per_kelvin=gear.within("viscous per kelvin", 0.005, 0.04),
        ),
    )
    return Stated(
        deviations=deviations,
        sidebands=tuple(
            Sideband(n, k, w.real, w.imag) for (n, k), w in zip(pairs, bands, strict=True)
        ),
        output_orders=_output_orders(gear) if newer else (),
        input_encoder=_encoder(
            bench, "input", (1, 2, 4), INPUT_CLASS, nominal.input_lines, skew=0.0
        ),
        output_encoder=_encoder(
            bench,
            "output",
            range(1, 9),
            OUTPUT_CLASS,
            nominal.output_lines,
            skew=bench.within("skew", 0.0, 1e-3),
            fine_orders=FINE_ORDERS if newer else range(0),
        ),
        torque_port=TorquePort(
            gain_error=bench.within("torque gain", -0.01, 0.01),
            offset=days.within("wide torque zero", -5e-3, 5e-3),
            drift_per_kelvin=nominal.torque_drift_per_kelvin,
            noise=nominal.torque_noise,
        ),
    )


def _output_orders(gear: _Draw) -> tuple[Sideband, ...]:
    waves = [gear.wave(f"output order {k}", 0.2 * ARCSEC, 3.0 * ARCSEC) for k in OUTPUT_ORDERS]
    return tuple(Sideband(0, k, w.real, w.imag) for k, w in zip(OUTPUT_ORDERS, waves, strict=True))


def _cogging(bench: _Draw, nominal: tuple[tuple[int, float], ...]) -> tuple[Harmonic, ...]:
    """The nominal orders in their proportion, the largest drawn, any phases [N m]."""
    random = bench.of("cogging")
    scale = random.uniform(0.0, 5e-3) / max(size for _, size in nominal)
    phases = random.uniform(0.0, REVOLUTION, len(nominal))
    return tuple(
        Harmonic(float(n), scale * size * math.cos(phase), scale * size * math.sin(phase))
        for (n, size), phase in zip(nominal, map(float, phases), strict=True)
    )


def _encoder(
    bench: _Draw,
    which: str,
    orders: range | tuple[int, ...],
    accuracy: float,
    lines: int,
    *,
    skew: float,
    fine_orders: range = range(0),
) -> EncoderErrors:
    """An encoder whose whole curve lies within its class: 0.5 to 1 of it. Its fine orders have their share of that."""
    random = bench.of(f"{which} encoder")
    raw = _waves(random, orders)
    if fine_orders:
        raw += _fine_waves(bench.of(f"{which} encoder fine orders"), fine_orders, raw)
    scale = accuracy * float(random.uniform(0.5, 1.0)) / half_width(raw)
    fine, phase = 0.01 * REVOLUTION / lines, float(random.uniform(0.0, REVOLUTION))
    return EncoderErrors(
        tuple(Harmonic(h.order, scale * h.cosine, scale * h.sine) for h in raw),
        Harmonic(float(lines), fine * math.cos(phase), fine * math.sin(phase)),
        float(random.uniform(0.0, REVOLUTION)),
        skew,
    )


def _waves(random: np.random.Generator, orders: range | tuple[int, ...]) -> list[Harmonic]:
    """Waves of uniform amplitude below 1, any phases."""
    shares, phases = (
        random.uniform(0.0, 1.0, len(orders)),
        random.uniform(0.0, REVOLUTION, len(orders)),
    )
    return [
        Harmonic(float(n), a * math.cos(p), a * math.sin(p))
        for n, a, p in zip(orders, map(float, shares), map(float, phases), strict=True)
    ]


def _fine_waves(random: np.random.Generator, orders: range, slow: list[Harmonic]) -> list[Harmonic]:
    """Waves of these orders whose curve is 5 to 20 % as wide as the whole one with the slow ones."""
    raw, share = _waves(random, orders), float(random.uniform(*FINE_SHARE))
    around = np.linspace(0.0, REVOLUTION, 7200, endpoint=False)
    below, above = series_value(slow, around), series_value(raw, around)
    size = share * float(np.ptp(below)) / float(np.ptp(above))
    # The whole is wider than the slow waves by at most what is added: each turn leaves a fifth of what was lacking.
    for _ in range(20):
        size = share * float(np.ptp(below + size * above)) / float(np.ptp(above))
    return [Harmonic(h.order, size * h.cosine, size * h.sine) for h in raw]
