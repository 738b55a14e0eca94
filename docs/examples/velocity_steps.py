"""Velocity steps from 60 to 3000 r/min, as in figure 19 of the paper: execute, fit, compare with the model, draw."""

from pathlib import Path

import rig

SPEEDS_RPM = (60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 2400.0, 3000.0)


def study(
    folder: Path, speeds_rpm: tuple[float, ...] = SPEEDS_RPM, **settings: object
) -> rig.Result:
    """The measured input prescribed: what equation 2 says with the card's values, and with those of the fit."""
    gear = rig.gear("csf-25-120")
    run = rig.execute(
        "velocity-steps",
        gear=gear,
        serial="SN-0815",
        folder=folder,
        speeds_rpm=speeds_rpm,
        **settings,
    )
    result = rig.fit(run)
    print(result)
    compared = result.compare(gear)
    print(compared)
    for rpm in speeds_rpm:
        compared.plot(f"velocity-step-{rpm:.0f}").savefig(folder / f"figure-19-{rpm:.0f}-rpm.png")
    return result


if __name__ == "__main__":
    study(Path("runs"))
