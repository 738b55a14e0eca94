"""What a run in real time may end as on a computer that is busy with something else: said as such, and safe.

Nothing of a test may depend on the computer's speed. So a test in real time either sees what it is for, or sees
that the program says why it could not.
"""

from __future__ import annotations

from rig.run.parts import RunReport
from rig.run.trips import LATE_TURN, MISSED_CYCLES, TRIPS

CAUSES = (MISSED_CYCLES, LATE_TURN)
RATE = "FAILED  acquisition, rate: "
"""What `rig doctor` says where this computer could not keep the rate."""
LATE = "this computer was late by more than half a cycle"
"""What `rig run` says beside an analysis that is refused, where the rows are stamped by the computer."""
SENTENCES = (*(TRIPS[cause].what for cause in CAUSES), "cycles complete", LATE)


def was_too_slow(report: RunReport) -> bool:
    """Whether the run says itself that the computer could not keep its cycles, and has made the rig safe."""
    if report.trip is not None:
        return report.trip.cause in CAUSES and report.safe
    return report.outcome == "ERROR" and says_too_slow(report.message) and report.safe


def says_too_slow(text: str) -> bool:
    """Whether words of the program (a report, a checklist of `rig doctor`) say that the computer was too slow."""
    failed = [line for line in text.splitlines() if line.startswith("FAILED")]
    if any(line.startswith(RATE) for line in failed):
        # Heartbeats come as late as the cycles do: what a device then says of itself follows from that.
        return True
    if failed:
        return all(line.startswith("FAILED  acquisition,") for line in failed)
    return any(sentence in text for sentence in SENTENCES)
