"""The table of the drills as it stands in the documentation."""

from __future__ import annotations

from collections.abc import Sequence

from rig.trial.drill.catalogue import DRILLS
from rig.trial.drill.suite import BLOCK_CYCLES, DrillRow

INTRODUCTION = """# Fault drills

What happens when something goes wrong, shown on simulated rigs: `rig drill` lets each fault happen in a short run at 1 kHz
(servo off, forward, reverse, standstill, torque mode, servo off) and says what came of it. The wire carries the real drivers
in front of simulated CANopen devices; `sim` is the direct rig. Hardware is refused.

- *detected*: the cause that was latched, or how the cycles are marked where the fault does no harm.
- *cycles*: SYNC periods from the onset to the reaction, with {block} cycles per exchange. Bounds of the guard end an exchange
  at the cycle that breaks them; everything else, the operator included, is looked at between two exchanges.
- *made safe*: the stages that were taken. *stands*: whether the motor of the simulated rig really stood without power in the
  end; *verified*: whether the program could verify that by statusword and encoders, each of them by itself: a node that is
  silent says nothing against the others, a device whose process data stay away is asked by SDO, and a drive that hears no
  process data is quick-stopped by SDO from the first cycle on and switched off by SDO once it stands. Statusword and input
  encoder must answer; an output encoder that does not is named.
  Where nobody can be heard (the bus is gone) nothing can be verified by software: the drive stops by itself because the
  computer's heartbeat stays away (0x1016, 0x6007), and the run says STANDSTILL NOT VERIFIED as loudly as it can.
- *file*: whether the run file, after `rig recover` where it was cut off, can be read and has its rows.
- A fault that does no harm leaves outcome and counts as they are without it; cycles with wrong counts are marked.

Made by `rig drill --markdown docs/drills.md`.
"""  # noqa: E501

LIMITS = """
## After a trip

The first cause is latched to the bench (`.tripped.json`; of a simulated rig in the folder of its runs) and outlives the program.
The next `rig run` on it is refused before the rig is connected, until somebody has acknowledged it by name: `rig acknowledge
--operator NAME --output DIR`, on hardware and on a hub `--config rig.toml` in the place of `--output`.
Who it was and what was found stays in `acknowledged-trips.jsonl`. Nothing starts again by itself.

## What this does not show

Software is not protection: the drive's own limits and the hardwired emergency stop are. The drills show that the program does
what it should with devices that behave as the simulated ones; a drive that obeys neither quick stop nor servo off can only be
stopped by the emergency stop.

A counter whose process data are always exactly one SYNC late cannot be told from one that is on time by anybody on the bus. The
next SYNC goes out only when every frame of a cycle is there, so a slow device makes the cycles longer, never late; what is left
is a device that sends, at each SYNC, what it latched at the one before. From the second cycle on there is one frame after each
SYNC, as from a healthy device of which one frame was lost; stamps and bytes are the same. Only the first and the last of those
cycles can be marked. It shows in the motion: the output lags the input by a whole cycle times the speed. The skew that is
estimated at the end of every run that turns both ways at several speeds finds it within microseconds; more than half a cycle is
a warning of the run and of every analysis of it.
"""  # noqa: E501


def markdown(rows: Sequence[DrillRow], without: Sequence[DrillRow]) -> str:
    """The document: introduction, table, limits. `without` are the same drills with every fault taken out."""
    lines = [
        INTRODUCTION.format(block=BLOCK_CYCLES),
        "| fault | what happens | rig | must be detected | detected | cycles | made safe | stands | verified | outcome "
        "| file | it happened | without it |",
        "|---|---|---|---|---|---:|---|---|---|---|---|---|---|",
    ]
    for row, bare in zip(rows, without, strict=True):
        cells = (
            row.fault,
            DRILLS[row.fault].what,
            row.carrier,
            row.expected_cause or "nothing",
            row.detected,
            str(row.cycles),
            row.action,
            _word(row.safe),
            _word(row.verified),
            row.outcome,
            _word(row.file_readable),
            row.evidence or "**no**",
            _without(bare),
        )
        lines.append(f"| {' | '.join(cells)} |")
    claiming = [row for row in without if row.claims_detection]
    failing = sum(not (row.passed or row.names_cause) for row in claiming)
    lines.append(
        f"\n{sum(row.passed for row in rows)} of {len(rows)} drills ended as they must. "
        f"{failing} of {len(claiming)} that claim a detection fail with their fault taken out."
    )
    return "\n".join(lines) + "\n" + LIMITS


def _word(value: bool) -> str:
    return "yes" if value else "**no**"


def _without(row: DrillRow) -> str:
    """What becomes of a drill with its fault taken out."""
    if not row.claims_detection:
        return "claims nothing"
    fails = "**passes**" if row.passed or row.names_cause else "fails"
    return f"{fails}: {', '.join(row.causes) or 'nothing detected'}, {row.outcome}"
