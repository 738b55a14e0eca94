"""Velocity steps from 60 to 3000 r/min, as in figure 19 of the paper: execute, fit, compare with the model, draw."""

from pathlib import Path
from typing import Any

import harmonic_rig as rig


def study(folder: Path, **settings: Any) -> rig.Result:
    """The measured input prescribed: what equation 2 says with the card's values, and with those of the fit."""
    gear = rig.gear("csf-25-120")
    run = rig.execute("velocity-steps", gear=gear, serial="SN-0815", folder=folder, **settings)
    result = rig.fit(run)
    print(result)
    compared = result.compare(gear)
    print(compared)
    for rpm in run.metadata.parameters["speeds_rpm"]:
        compared.plot(f"velocity-step-{rpm:.0f}").savefig(folder / f"figure-19-{rpm:.0f}-rpm.png")
    return result


if __name__ == "__main__":
    study(Path("runs"))
