"""What a simulated rig knows of itself beside what an analysis found: for demonstrations and
coverage, never for analyses.

The truth is the mapping that a simulated rig writes into its run file, made of what was drawn. Each
quantity has two, and no analysis has a part in either:

seen        what this bench sees: the torque port reads (1 + scale error) times the true torque, the output
            bearing turns with the gear, encoders and mounting stand in what is measured of the kinematic error
measurand   what the quantity is defined for: the gear alone, or the motor alone, by a perfect bench

Both hold at the run's own mean temperature, those at 20 degC at 20 degC. What a result says that it
took off (a tare, a bearing of the bench that was entered, the warmth of the magnets) is no longer seen.
"""

from __future__ import annotations

import cmath
import dataclasses
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from experiments.errors import AnalysisError
from experiments.recording import mapping_of
from experiments.result import Result
from model.identify.estimate import Estimate
from model.units import RPM

AT_REFERENCE = "_at_20_degrees"
"""How the names of what is stated at 20 degC end."""
FORCES = ("coulomb", "static", "viscous")
_Truths = Iterator[tuple[str, float, float]]
"""Name, what this bench sees, measurand."""


@dataclass(frozen=True)
class TruthRow:
    """One identified quantity beside its two truths, in the same unit and frame."""

    estimate: Estimate
    seen: float
    measurand: float

    @property
    def difference(self) -> float:
        """Found minus what this bench sees; on the circle for phases."""
        return self._from(self.seen)

    @property
    def error(self) -> float:
        """Found minus the measurand; on the circle for phases."""
        return self._from(self.measurand)

    @property
    def covered(self) -> bool:
        """Whether the statistical interval (95 %, type A) holds what this bench sees."""
        e = self.estimate
        return e.low <= e.value - self.difference <= e.high

    @property
    def within(self) -> bool:
        """Whether value +- U, type B included, holds the measurand."""
        return abs(self.error) <= self.estimate.expanded_uncertainty

    def _from(self, truth: float) -> float:
        away = self.estimate.value - truth
        name = self.estimate.name
        is_angle = name.startswith("phase") or name.endswith("_index")
        return math.remainder(away, 2.0 * math.pi) if is_angle else away


def truth_of(metadata_process: Mapping[str, Any]) -> Mapping[str, Any]:
    """The truth that the process record of a run carries, with its mean and last temperatures if it came to its end.

    Raises `AnalysisError` where there is none.
    """
    truth = metadata_process.get("truth")
    if not isinstance(truth, Mapping):
        raise AnalysisError(
            "the run carries no truth",
            where="process.truth",
            remedy="Only runs of the simulated rig know theirs.",
        )
    state = metadata_process.get("acquisition", {}).get("thermal_state", {})
    return {
        **truth,
        "mean_temperatures": state.get("mean", {}),
        "end_temperatures": state.get("end", {}),
    }


def truth_rows(result: Result, truth: Mapping[str, Any]) -> tuple[TruthRow, ...]:
    """Every estimate of a result whose true value the rig knows, in the order of the result."""
    maker = _MAKERS.get(result.kind)
    if maker is None:
        return ()
    truths = {name: (seen, measurand) for name, seen, measurand in maker(result, _Truth(truth))}
    return tuple(
        TruthRow(dataclasses.replace(estimate, name=name), *truths[name])
        for name, estimate in result.estimates.items()
        if name in truths
    )


@dataclass(frozen=True)
class _Truth:
    """The record of a simulated rig, and what its temperatures make of it."""

    record: Mapping[str, Any]

    def part(self, name: str) -> Mapping[str, Any]:
        return mapping_of(self.record.get(name))

    def heat(self, name: str) -> float:
        return float(self.part("thermal").get(name, 0.0))

    @property
    def reference_warmer(self) -> float:
        """How much warmer 20 degC is than the rig's own reference [K]; 0 where nothing warms."""
        return 20.0 - self.heat("reference") if self.part("thermal") else 0.0

    def motor_warmer(self, when: str = "mean") -> float:
        """How much warmer the motor was than the reference [K], on average or at the "end"; 0 where nothing warms."""
        if "reference" not in self.part("thermal"):
            return 0.0
        warm = self.part(f"{when}_temperatures").get("motor", self.heat("reference"))
        return float(warm) - self.heat("reference")

    def warmer(self, result: Result) -> float:
        """How much warmer the housing was than the reference [K]: by the thermometer, whose error is known here."""
        if "reference" not in self.part("thermal"):
            return 0.0
        housing = result.metrics.get("housing_temperature", math.nan)
        if math.isfinite(housing):
            housing -= float(self.part("thermometer").get("housing_offset", 0.0))
        else:
            mean = self.part("mean_temperatures")
            housing = float(mean.get("housing", self.heat("reference")))
        return housing - self.heat("reference")

    def scale(self, when: str = "mean") -> float:
        """What the torque port shows of a torque, as a factor."""
        port, motor = self.part("torque_port"), self.motor_warmer(when)
        weaker = 1.0 - self.heat("torque_constant_per_kelvin") * motor
        return (1.0 + float(port.get("scale_error", 0.0))) / weaker


@dataclass(frozen=True)
class _Friction:
    """Friction of the true gear, and of the bench's output bearing, `warmer` than the reference by so many K."""

    truth: _Truth
    warmer: float

    @property
    def own(self) -> Mapping[str, Any]:
        return self.truth.part("friction")

    @property
    def dry(self) -> float:
        return 1.0 - self.truth.heat("coulomb_per_kelvin") * self.warmer

    @property
    def thin(self) -> float:
        return math.exp(-self.truth.heat("viscous_per_kelvin") * self.warmer)

    def gear(self, name: str) -> float:
        """A parameter of the gear alone, of equation 19."""
        change = {"coulomb": self.dry, "static": self.dry, "viscous": self.thin}.get(name, 1.0)
        return change * float(self.own[name])

    def bearing(self, name: str) -> float:
        """What the output bearing is worth as a force at the mesh [N], [N s/rad]."""
        part = "viscous" if name == "viscous" else "coulomb"
        if "output_bearing_at_mesh" in self.own:
            at_mesh = float(self.own["output_bearing_at_mesh"][part])
        else:
            at_mesh = float(self.own["measurable"][part]) - float(self.own[part])
        law = float(self.own.get("output_bearing_per_kelvin", 0.0))
        return at_mesh * (1.0 - law * self.warmer)

    def gear_torque(self, speed: float) -> float:
        """The gear's own friction torque at an input speed [rad/s] [N m]; 0 is that of a start (equations 18, 19)."""
        decay = math.exp(
            -((speed / float(self.own["stribeck_velocity"])) ** float(self.own["shape"]))
        )
        coulomb, static = self.gear("coulomb"), self.gear("static")
        mesh = coulomb + (static - coulomb) * decay + self.gear("viscous") * speed
        still = self._no_load(0.0)
        grown = self._no_load(speed) - still
        drag = self.dry * still + self.thin ** (2.0 / 3.0) * grown
        return float(self.own["mesh_lever"]) * mesh + float(self.own["bearing_lever"]) * drag

    def _no_load(self, speed: float) -> float:
        """M_0 of equation 18 [N m]; speed in r/min and viscosity in mm2/s, below 2000 as at 2000."""
        bearing = self.own["bearing_torque"]
        product = float(bearing["viscosity"]) * 1e6 * speed / RPM
        if bearing["low_speed_branch"]:
            product = max(product, 2000.0)
        size = float(bearing["friction_factor"]) * float(bearing["pitch_diameter"]) ** 3
        return 0.1 * size * product ** (2.0 / 3.0)

    def bearing_torque(self, speed: float) -> float:
        """What the output bearing adds at the input [N m]."""
        forces = self.bearing("coulomb") + self.bearing("viscous") * speed
        return float(self.own["mesh_lever"]) * forces


def _friction(result: Result, truth: _Truth) -> _Truths:
    """Parameters of equation 19 and running torques, at the run's temperature and at 20 degC."""
    own = truth.part("friction")
    if result.options.get("torque_is_of") != "gear" or own.get("torque_balance") != (
        result.options.get("torque_balance")
    ):
        return
    taken = {
        "coulomb": result.metrics.get("output_bearing_subtracted", 0.0),
        "viscous": result.metrics.get("output_bearing_viscous_subtracted", 0.0),
    }
    taken["static"] = taken["coulomb"]
    scale = truth.scale()
    for suffix, warmer in (
        ("", truth.warmer(result)),
        (AT_REFERENCE, truth.reference_warmer),
    ):
        at = _Friction(truth, warmer)
        for name in FORCES:
            seen = scale * (at.gear(name) + at.bearing(name)) - taken[name]
            yield name + suffix, seen, at.gear(name)
        for name in ("stribeck_velocity", "shape"):
            yield name + suffix, at.gear(name), at.gear(name)
        for speed_rpm in _speeds(result.estimates, suffix) if "mesh_lever" in own else ():
            speed = speed_rpm * RPM
            gear = at.gear_torque(speed)
            off = float(own["mesh_lever"]) * (taken["coulomb"] + taken["viscous"] * speed)
            seen = scale * (gear + at.bearing_torque(speed)) - off
            yield f"running_torque_{speed_rpm:g}_rpm{suffix}", seen, gear


def _speeds(names: Iterable[str], suffix: str) -> Iterator[float]:
    """The speeds [r/min] at which running torques are named."""
    for name in names:
        found = re.fullmatch(rf"running_torque_([0-9.]+)_rpm{suffix}", name)
        if found:
            yield float(found[1])


def _tare(result: Result, truth: _Truth) -> _Truths:
    """Friction of the motor alone, as warm as it was on average, and at 20 degC."""
    motor, scale = truth.part("motor"), truth.scale()
    for suffix, warmer in (("", truth.motor_warmer()), (AT_REFERENCE, truth.reference_warmer)):
        weaker = 1.0 - truth.heat("motor_friction_per_kelvin") * warmer
        for name in ("coulomb", "viscous"):
            if name in motor:
                own = weaker * float(motor[name])
                yield f"motor_{name}{suffix}", scale * own, own


def _torque_scale(result: Result, truth: _Truth) -> _Truths:
    """What the port shows of rotor and disc, as warm as the motor was on average, and its lag."""
    shaft = float(truth.part("inertia").get("total_at_input", math.nan))
    yield "shown_inertia", truth.scale() * shaft, truth.scale() * shaft
    lag = float(truth.part("torque_port").get("lag", math.nan))
    yield "torque_lag", lag, lag


def _home(result: Result, truth: _Truth) -> _Truths:
    """The edge that the motor's forward turn meets, on a circle without errors; the counter shows its encoder's error
    there beside it.

    A mark is one count wide: an encoder that counts down meets the far edge of it.
    """
    encoders = truth.part("encoders")
    for which, sense in (("input", 1), ("output", encoders.get("output_sense", 1))):
        own = encoders.get(which, {})
        if "index_error" in own:
            edge = float(own["index_angle"]) + (float(own["quantum"]) if sense < 0 else 0.0)
            yield f"{which}_index", edge + float(own["index_error"]), edge


def _warm_up(result: Result, truth: _Truth) -> _Truths:
    """Motor, gear and the bench's output bearing at the speed of the holds, with which the run ends."""
    own, motor, speed = truth.part("friction"), truth.part("motor"), result.metrics.get("speed")
    if "mesh_lever" not in own or speed is None:
        return
    at = _Friction(truth, truth.warmer(result))
    weaker = 1.0 - truth.heat("motor_friction_per_kelvin") * truth.motor_warmer("end")
    alone = weaker * (float(motor["coulomb"]) + float(motor["viscous"]) * speed)
    all_that_turns = at.gear_torque(speed) + at.bearing_torque(speed) + alone
    taken = result.metrics.get("torque_constant_factor", 1.0)
    yield "running_torque", taken * truth.scale("end") * all_that_turns, all_that_turns


def _starting_torque(result: Result, truth: _Truth) -> _Truths:
    """Motor and gear from rest, in the mean over all positions; the bench's output bearing is no part of it."""
    own, motor = truth.part("friction"), truth.part("motor")
    if "mesh_lever" not in own or result.options.get("torque_is_of") != "motor + gear":
        return
    off = result.metrics.get("output_bearing_torque", 0.0)

    def torques(warmer: float, motor_warmer: float) -> tuple[float, float]:
        at = _Friction(truth, warmer)
        weaker = 1.0 - truth.heat("motor_friction_per_kelvin") * motor_warmer
        both = at.gear_torque(0.0) + weaker * float(motor["coulomb"])
        return truth.scale() * (both + at.bearing_torque(0.0)) - off, both

    seen, both = torques(truth.warmer(result), truth.motor_warmer())
    for way, sign in (("", 1.0), ("_forward", 1.0), ("_reverse", -1.0)):
        yield f"starting_torque{way}", sign * seen, sign * both
    yield f"starting_torque{AT_REFERENCE}", *torques(truth.reference_warmer, truth.reference_warmer)


def _kinematic_error(result: Result, truth: _Truth) -> _Truths:
    """Amplitudes, phases from the mark of the result, and peak to peak; an order that nothing makes has amplitude 0."""
    error = truth.part("kinematic_error")
    ratio = float(result.options.get("ratio", math.nan))
    reference = float(result.options.get("phase_reference_angle", 0.0))
    seen = _series(error.get("measurable", ()), 0.0)
    if "measurable_recorded" in error:
        seen = _series(error["measurable_recorded"], reference)
    turn = reference - float(error.get("reference_angle", reference))
    alone = _series(error["orders"], turn) if "orders" in error else seen
    for name in result.estimates:
        what, _, label = name.partition("_")
        order = _order_of(label, ratio) if what in ("amplitude", "phase") else None
        if order is None:
            continue
        pair = _at_order(seen, order), _at_order(alone, order)
        if what == "amplitude":
            yield name, abs(pair[0]), abs(pair[1])
        elif pair[0]:
            yield name, -cmath.phase(pair[0]), -cmath.phase(pair[1] or pair[0])
    if "measurable_peak_to_peak" in error:
        # What the fitted curve is of: an output encoder's orders above 8 are looked for by no analysis.
        slow = error.get("measurable_peak_to_peak_of_slow_orders")
        whole = float(error["measurable_peak_to_peak"] if slow is None else slow)
        for way in ("", "_forward", "_reverse"):
            name = f"transmission_accuracy{way}"
            seen_whole = max(whole - _raised(result, way), 0.0)
            yield name, seen_whole, float(error.get("peak_to_peak", whole))


def _raised(result: Result, way: str) -> float:
    """What the result took off the peak-to-peak; of one direction alone its metric bears that direction's name."""
    metrics = result.metrics
    names = [f"raised_by_bench{one}" for one in (way, "_forward", "_reverse")]
    return next((metrics[name] for name in names if name in metrics), 0.0)


def _order_of(label: str, ratio: float) -> float | None:
    """Cycles per input revolution of "2", "3/N", "2-1/N"; None for what is no order."""
    found = re.fullmatch(r"(\d+)|(\d+)/N|(\d+)([+-]\d+)/N", label)
    if found is None:
        return None
    whole, output, beside, k = found.groups()
    if whole is not None:
        return float(whole)
    return int(output) / ratio if output is not None else int(beside) + int(k) / ratio


def _series(orders: Iterable[Mapping[str, float]], turn: float) -> dict[float, complex]:
    """c of a cos(n x) + b sin(n x) = Re c exp(j n x), x counted from `turn` on."""
    return {
        o["order"]: complex(o["cosine"], -o["sine"]) * cmath.exp(1j * o["order"] * turn)
        for o in orders
    }


def _at_order(series: Mapping[float, complex], order: float) -> complex:
    return sum(c for other, c in series.items() if abs(other - order) < 1e-9)


def _steps(result: Result, truth: _Truth) -> _Truths:
    """Secant stiffness over inertia, mode and damping at the named torque amplitude; inertia and stiffness by torque.

    The torque port's scale stands in what torque tells: it is read for rotor and output together,
    and the rotor is taken off as the card has it.
    """
    dynamics = truth.part("dynamics")
    if "stiffness_over_inertia" not in dynamics:
        return
    ratio, inertia = float(dynamics["stiffness_over_inertia"]), float(dynamics["output_inertia"])
    for suffix in ("", "_forward", "_reverse"):
        yield f"stiffness_over_inertia{suffix}", ratio, ratio
        if "damping_ratio" in dynamics:
            frequency, damping = float(dynamics["resonance"]), float(dynamics["damping_ratio"])
            yield f"frequency{suffix}", frequency, frequency
            seen = float(dynamics["damping_ratio_with_output_bearing"])
            seen -= result.metrics.get("output_bearing_damping_subtracted", 0.0)
            yield f"damping_ratio{suffix}", seen, damping
    # The rotor's inertia is a number of the same fit: a scale error of the torque scales both alike.
    carried = truth.scale() * inertia
    yield "output_inertia", carried, inertia
    yield "output_stiffness", ratio * carried, ratio * inertia


_MAKERS: Mapping[str, Callable[[Result, _Truth], _Truths]] = {
    "friction": _friction,
    "motor-tare": _tare,
    "torque-scale": _torque_scale,
    "kinematic-error": _kinematic_error,
    "velocity-steps": _steps,
    "starting-torque": _starting_torque,
    "home": _home,
    "warm-up": _warm_up,
}
