"""How well the exported law of friction holds on gears that nobody tuned it on.

    python -m tests.benchmarks.export_study --first-seed 7800 --gears 100

Wide gears of the simulated world. Of each: relative error of the LuGre form over 3 to 3000 r/min, and of the speed at
which the torque of equation 20 at 300, 1000 and 3000 r/min becomes steady by it. What misses is named.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from scipy.optimize import brentq

from model.friction import friction_torque
from model.gear import HarmonicDrive
from model.gear_file import shipped_gear
from model.motor import shipped_motor
from model.units import RPM
from rig.exchange.identified import of_set
from rig.exchange.joint import Form, forms_of, seen_from
from sim_backend.population import drawn
from sim_backend.world import World

STEADY_RPM = (300.0, 1000.0, 3000.0)
LARGEST_RMS, LARGEST_SPEED = 0.02, 0.01


def speed_error(gear: HarmonicDrive, form: Form, speed: float) -> float:
    """Relative error of the steady speed by the form, where equation 20 has `speed` [rad/s]; NaN where it has none."""
    torque = float(friction_torque(gear, speed))
    low, high = 0.5 * speed, 2.0 * speed
    if (float(form.torque(low)) - torque) * (float(form.torque(high)) - torque) > 0.0:
        return math.nan
    return brentq(lambda v: float(form.torque(v)) - torque, low, high) / speed - 1.0


def is_rising(gear: HarmonicDrive, speed: float) -> bool:
    """Whether friction grows with speed there, so that a torque has a steady speed at all."""
    below, above = friction_torque(gear, [0.98 * speed, 1.02 * speed])
    return bool(above > below)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first-seed", type=int, required=True)
    parser.add_argument("--gears", type=int, default=100)
    chosen = parser.parse_args()
    rms: list[float] = []
    errors: dict[float, list[float]] = {rpm: [] for rpm in STEADY_RPM}
    for seed in range(chosen.first_seed, chosen.first_seed + chosen.gears):
        world = World(gear_seed=seed, bench_seed=1, population="wide")
        gear = drawn(shipped_gear(), shipped_motor(), world).gear
        form = forms_of(seen_from(of_set(gear), "motor"))["lugre"]
        rms.append(form.rms)
        found = {
            rpm: speed_error(gear, form, rpm * RPM)
            for rpm in STEADY_RPM
            if is_rising(gear, rpm * RPM)
        }
        for rpm, error in found.items():
            errors[rpm].append(error)
        missed = {
            f"{rpm:g} r/min": f"{e:+.2%}" for rpm, e in found.items() if not abs(e) < LARGEST_SPEED
        }
        if form.rms >= LARGEST_RMS or missed:
            print(f"gear {seed}: r.m.s. {form.rms:.2%}, steady speeds beyond: {missed or 'none'}")
    within = sum(one < LARGEST_RMS for one in rms)
    print(
        f"r.m.s. below 2 %: {within} of {len(rms)}, median {np.median(rms):.2%}, worst {max(rms):.2%}"
    )
    for rpm, found_errors in errors.items():
        close = sum(abs(one) < LARGEST_SPEED for one in found_errors)
        worst = max(map(abs, found_errors), default=math.nan)
        print(
            f"steady speed at {rpm:g} r/min within 1 %: {close} of {len(found_errors)}, worst {worst:.2%}"
        )


if __name__ == "__main__":
    main()
