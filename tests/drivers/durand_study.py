"""Every drill on the wire with a servo amplifier on another CANopen stack: `python -m tests.drivers.durand_study`.

A study, no test: the drills' causes are those of our simulated drive. What a drive cannot do is listed with why.
"""

from __future__ import annotations

from rig.trial.drill import rigs
from rig.trial.drill.catalogue import every_drill
from rig.trial.drill.suite import run_drills
from tests.drivers.durand_drive import DurandBench

DIFFERS = {
    "statusword fault, motor coasts": "its statusword shows the fault in the cycle of its emergency message",
    "NMT PRE-OPERATIONAL from outside": "its heartbeat tells it later than its missing process data",
    "NMT PRE-OPERATIONAL from outside, all nodes": "the same",
    "NMT STOPPED from outside": "the same",
    "NMT STOPPED from outside, drive goes on": "the same",
    "NMT START while made safe": "the same",
    "SYNC gone for good, drive minds": "it does not supervise the SYNC (0x1006)",
    "SYNC supervision trips": "it does not supervise the SYNC (0x1006)",
    "mode changed by another master": "it has no profile torque and refuses the mode",
    "slip, input": "it has no touch probe: the motor encoder's index mark is not seen",
}
"""Where this drive lets another cause be named first, or has nothing by which it could be seen."""


def main() -> None:
    rigs.WireBench = DurandBench  # type: ignore[misc]
    drills = [drill for drill in every_drill().values() if "wire" in drill.carriers]
    passed = safe = 0
    for row in run_drills(drills, backend="wire"):
        passed += row.passed
        safe += row.safe
        if not row.passed:
            why = DIFFERS.get(row.fault, "NOT EXPECTED")
            print(f"{row.fault}: {row.outcome}, {row.detected or 'nothing detected'}; {why}")
    print(
        f"{len(drills)} drills: {safe} safe by the plant, {passed} with the cause of our own drive"
    )


if __name__ == "__main__":
    main()
