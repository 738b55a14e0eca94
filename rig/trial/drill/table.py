"""The table of the drills as it stands in the documentation."""

from __future__ import annotations

from collections.abc import Sequence

from rig.trial.drill.catalogue import every_drill
from rig.trial.drill.pairs import APART
from rig.trial.drill.suite import BLOCK_CYCLES, DrillRow

INTRODUCTION = """# Fault drills

What happens when something goes wrong, shown on simulated rigs: `rig sim drill` lets each fault happen in a short run at 1 kHz
(servo off, forward, reverse, standstill, torque mode, servo off) and says what came of it. The wire carries the real drivers
in front of simulated CANopen devices; `sim` is the direct rig. Hardware is refused.

A drill passes only when all of this is true:

- *It happened*, by the count of whoever let it happen: frames that were dropped or altered, rows of counts that differ, time
  stamps that were shifted, blocks that the disk did not take, the cycle from which it acted on a device, the press that was
  delivered. A fault that found nothing to alter has not happened.
- *Its cause was detected*: the one that the drill names beforehand, be it the cause of a trip, a mark of the cycles, the
  operator's word, a check or a reading that was refused, or a stop that was not obeyed. Another cause is not enough. Two drills
  name none, because there is nothing to detect: there the counts must be right and nothing may be detected.
- *The motor stands*, by the truth of the simulated plant on both rigs: it turns no more and has no power in the end, and stood
  so at the instant at which the program said that it does.
- The outcome is the one that the drill must have, the file can be read, and no wrong count stands in it without a mark.

`rig sim drill --without-faults` makes the same runs with a fault that does nothing. Each drill that claims a detection must then
fail, and not only because nothing happened: none may find its cause. It ends with exit code 0 when they all fail, else with 6.
A press that only gives a fault its occasion stays: *quick stop not obeyed* without its fault is an ABORT that is obeyed.

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

Made by `rig sim drill --markdown docs/drills.md`, which makes every run with and without its fault.
"""  # noqa: E501

PAIRS = """
## Pairs at random

`rig sim drill --pairs N --seed S` lets two faults happen in one run: the first at a random moment from the first look at the rig to
the servo off, the second within {apart} cycles of it, while the first is being dealt with. Every fault of the table that can
happen at any moment is drawn, STOP and ABORT once each; a disk fails in one way at a time. Pair k of a seed is the same
as long as the table of faults is. It does not ask which cause was named, but for the truth: does the motor stand without power,
and does the program say so. A run that hangs or breaks is held against the same truth.

A study of 1000 pairs (`python -m tests.benchmarks.drill_pairs --seed 25112 --pairs 1000 --to rows.jsonl`, the seed written down
before, looked at once):

| by the plant's truth, and by the program's word | pairs |
|---|---:|
| the motor stands without power, and the program has verified it | 941 |
| it stands; the bus is gone for one of the faults, nobody can be heard, and the run says STANDSTILL NOT VERIFIED | 53 |
| it stands, and the program could not say so | 4 |
| it turns, or has power | 2 |

The two that turned: *quick stop not obeyed*, then *bus lost* (89), a drive that obeys nothing and to which nobody can speak any more; and
*something drags at the output* (710), 200 N m on the output of a motor that had been made safe and has no power. The four that could not
be said are lies of one encoder in a row (170, 255, 552, 982: first stuck, then jumping or running): one observer says that the shaft
turns, and is not overruled. No file was unreadable: three runs whose bus was gone within the first rows (328, 700, 736) are refused, and
leave a sealed file.

An earlier study (seed 4711) left six. `python -m tests.benchmarks.drill_pairs --seed 4711 --known` makes these again, by their
faults and rows:

| pair | what the two faults leave | now |
|---|---|---|
| 34, 303 | *no data for 0.4 s* while a servo off is verified, after lost data or a drive fault | stands, verified: it was the drill that waited 0.6 s only; it waits 1.2 s now, a rig of hardware 3 s |
| 808 | *SDO time-out*, then *NMT STOPPED*: the drive is heard neither by process data nor by SDO. Only NMT START would make it heard again; whoever is started follows whatever process data are on the bus, so it is never sent here. The drive stands by 0x6007 | stands, not verified |
| 418, 538 | the output's count lies twice, first stuck and then running: one observer says that the output turns. A coupling that is torn with the output driven looks the same; an observer is not overruled | stands, not verified |
| 882 | a drive that obeys nothing, and then nobody can speak to it | turns: the emergency stop |

The same script runs any number of pairs, goes on where it was ended, and judges more than `rig sim drill --pairs`: the file must be
readable, and no count before the first fault, or where neither fault may do harm, may be wrong without a mark.
"""  # noqa: E501

LIMITS = """
## After a trip

The first cause is latched to the bench (`.tripped.json`; of a simulated rig in the folder of its runs) and outlives the program.
The next `rig run` on it is refused before the rig is connected, until somebody has acknowledged it by name: `rig acknowledge
--operator NAME --runs DIR`, on hardware and on a hub `--config rig.toml` in the place of `--runs`.
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
            every_drill()[row.fault].what,
            row.carrier,
            *outcome_cells(row, "**no**"),
            row.evidence or "**no**",
            _without(bare),
        )
        lines.append(f"| {' | '.join(cells)} |")
    claiming = [row for row in without if row.claims_detection]
    failing = sum(not row.names_cause for row in claiming)
    lines.append(
        f"\n{sum(row.passed for row in rows)} of {len(rows)} drills ended as they must. "
        f"{failing} of {len(claiming)} that claim a detection fail with their fault taken out."
    )
    return "\n".join(lines) + "\n" + PAIRS.format(apart=APART) + LIMITS


def outcome_cells(row: DrillRow, no: str) -> tuple[str, ...]:
    """What came of a drill, from the cause that must be detected to the file; `no` is how the table shouts."""
    words = {True: "yes", False: no}
    return (
        row.expected_cause or "nothing",
        row.detected,
        str(row.cycles),
        row.action,
        words[row.safe],
        words[row.verified],
        row.outcome,
        words[row.file_readable],
    )


def _without(row: DrillRow) -> str:
    """What becomes of a drill with its fault taken out."""
    if not row.claims_detection:
        return "claims nothing"
    fails = "**finds its cause**" if row.names_cause else "fails"
    return f"{fails}: {', '.join(row.causes) or 'nothing detected'}, {row.outcome}"
