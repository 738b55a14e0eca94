"""Friction at constant speeds, as in figures 9 and 17 of the paper: execute, fit, compare with the model, draw."""

from pathlib import Path
from typing import Any

import harmonic_rig as rig


def study(folder: Path, points: int = 30, **settings: Any) -> rig.Result:
    """The motor alone first: its torque is the tare, which the fit of the friction finds in the folder by itself."""
    gear = rig.gear("csf-25-120")
    rig.execute("motor-tare", folder=folder, points=points, **settings)
    run = rig.execute(
        "friction", gear=gear, serial="SN-0815", folder=folder, points=points, **settings
    )
    result = rig.fit(run)
    print(result)
    print(f"F_c = {result['coulomb'].value:.1f} N, U = {result['coulomb'].uncertainty:.1f} N")
    compared = result.compare(gear)
    print(compared)
    result.plot("9").savefig(folder / "figure-9.png")
    compared.plot("17").savefig(folder / "figure-17.png")
    return result


if __name__ == "__main__":
    study(Path("runs"))
