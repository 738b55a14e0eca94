"""Kinematic error at low velocity, as in figures 12 and 13 of the paper: execute, fit, compare with the model, draw."""

from pathlib import Path
from typing import Any

import harmonic_rig as rig


def study(folder: Path, **settings: Any) -> rig.Result:
    """One output revolution each way; the series of the gear's card held against what the gear shows."""
    gear = rig.gear("csf-25-120")
    run = rig.execute("kinematic-error", gear=gear, serial="SN-0815", folder=folder, **settings)
    result = rig.fit(run)
    print(result)
    print(result.compare(gear))
    result.plot("12").savefig(folder / "figure-12.png")
    result.plot("13").savefig(folder / "figure-13.png")
    return result


if __name__ == "__main__":
    study(Path("runs"))
