"""The table of checks: what a recording must be before anything is computed from it.

Every analysis passes it first, from one place (`experiments.catalogue.load`). Each row names what
it looks at, for which kinds of analysis, and by which function; the functions stand in `motion`,
`continuity`, `torque`, `dead_band`, `inertia`, `sampling`, `steps` and `tare`. A check that a recording
lacks the channels for says "not checked".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

from experiments.contract import Evidence
from experiments.errors import AnalysisError
from experiments.evidence import (
    continuity,
    dead_band,
    inertia,
    motion,
    sampling,
    steps,
    tare,
    torque,
)
from experiments.evidence.holds import Recorded
from experiments.finding import Finding, Severity
from experiments.setting import EVERY_KIND, names_of

SETTINGS = names_of(EVERY_KIND)
"""Settings that belong to the checks: every kind of fit has them."""


@dataclass(frozen=True)
class Row:
    """One line of the table: its name, whether this analysis needs it, how to look, what to do when refused.

    `is_evidence`: whether a verdict needs the check to have been made.
    """

    name: str
    concerns: Callable[[Recorded], bool]
    look: Callable[[Recorded], Finding]
    remedy: str
    is_evidence: bool = True

    def named(self, found: Finding) -> Finding:
        """What was found, with the name of the check, and what to do where something is wrong."""
        is_open = found.severity in (Severity.NOTES, Severity.BLOCKS)
        return dataclasses.replace(
            found,
            what=self.name,
            remedy=self.remedy if is_open else "",
            is_evidence=self.is_evidence,
        )


def _every(_: Recorded) -> bool:
    return True


def _set_speed(recorded: Recorded) -> bool:
    """Whether its segments are set to speeds; of a recording without a plan they may be."""
    return not recorded.experiment.has_plan or recorded.experiment.setpoint == "speed"


def _gear(recorded: Recorded) -> bool:
    return recorded.experiment.gear_mounted and recorded.recording.metadata.gear_mounted


def _output(recorded: Recorded) -> bool:
    """Whether both angles of one cycle are compared."""
    return _gear(recorded) and bool({"slope", "frequency"} & recorded.quantities)


def _transmission(recorded: Recorded) -> bool:
    return "transmission_accuracy" in recorded.quantities


def _mode(recorded: Recorded) -> bool:
    return "frequency" in recorded.quantities


def _shaped(recorded: Recorded) -> bool:
    """Whether it rests on jumps of speed, and the run tells how its drive followed them."""
    return _mode(recorded) and recorded.experiment.has_plan and steps.tells_mode(recorded)


def _torque(recorded: Recorded) -> bool:
    """Whether it rests on a torque."""
    return "torque" in recorded.experiment.needs


def _bracket(recorded: Recorded) -> bool:
    return "bracket_drift" in recorded.quantities


def _tare(recorded: Recorded) -> bool:
    return recorded.evidence.tare is not None


_CYCLIC = (
    "Use a drive with cyclic synchronous velocity, or leave steps to recordings made with one."
)
_RUN_AGAIN = "Run it again, to its end."
_RECORD_AGAIN = "Repair the acquisition and record again, or allow more missed cycles with --largest-missed-share."
_LOOK_AT_PORT = (
    "Check range, scale, unit and sign of the torque channel (rig.toml, or the map of the import)."
)
_LOOK_AT_ENCODERS = (
    "Check lines, multiplication and sense of both encoders, the gear's ratio and its mounting."
)
_LOOK_AT_TIME = (
    "Check unit and scale of the time stamps and the clock of the device; run again if the "
    "computer's was set."
)

_LOOK_AT_COUNTS = "Check lines and multiplication of the input encoder, and the time stamps."
_SYNC_DEVICES = "Set the devices to transmit what they latched at the same SYNC."
_HIGHER_RATE = "Record at a higher rate."
OTHER_SPEED = "Choose a speed that is incommensurate with the sampling rate."
_LOOK_AT_ZERO = "Look at the torque channel about zero: amplifier, converter, a filter or a threshold in the drive."
_LOOK_AT_OUTPUT = "Look at lines, multiplication and cut-off bits of the output encoder; state the counts that it has."
_FINER_PORT = "Use a finer range or converter of the torque channel."
_LOOK_AT_SCALE = "Check the scale of the torque channel and the inertia on the cards: rotor, gear, load (rig gear set)."
_WIDER_RANGE = "Widen the range of the torque port, and run again."
_WARM_UP = "Warm up first, and run again."
_SAME_RIG = "Take the tare on the rig of the run."
_NEW_TARE = "Take a new tare, or allow more with the setting tare_age_limit."
_TARE_AGAIN = (
    "Look for a rubbing coupling, a cold motor, a wrong scale or card; take the tare again, before and "
    "after the run (rig run motor-tare)."
)
_SAME_ROOM = "Take a new tare at this temperature."

TABLE: tuple[Row, ...] = (
    Row("end of the run", _every, sampling.end_of_run, _RUN_AGAIN),
    Row("gaps", _every, sampling.gaps, _RECORD_AGAIN),
    Row("time axis", _every, sampling.time_axis, _LOOK_AT_TIME),
    Row("speed against set-point", _set_speed, motion.speed_against_set_point, _LOOK_AT_COUNTS),
    Row("encoders against ratio", _gear, motion.encoders_against_ratio, _LOOK_AT_ENCODERS, False),
    Row("saturation", _torque, torque.saturation, _WIDER_RANGE),
    Row("plateau", _torque, torque.plateau, _WIDER_RANGE),
    Row("continuity", _set_speed, continuity.continuity, _RECORD_AGAIN),
    Row("skew of the encoders", _output, motion.skew, _SYNC_DEVICES, False),
    Row("steps of the output", _output, sampling.steps_of_the_output, _LOOK_AT_OUTPUT, False),
    Row("sampling of the resonance", _mode, sampling.resonance, _HIGHER_RATE),
    Row("shape of the steps", _shaped, steps.shape_of_the_steps, _CYCLIC, False),
    Row("count lattice", _transmission, sampling.count_lattice, OTHER_SPEED, False),
    Row("sign of the torque", _torque, torque.sign, _LOOK_AT_PORT),
    Row("reach of the motor", _torque, torque.reach, _LOOK_AT_PORT),
    Row("torque zero", _torque, torque.zero, _WARM_UP),
    Row("reference speed", _bracket, torque.bracket, _WARM_UP, False),
    Row("dead band", _torque, dead_band.dead_band, _LOOK_AT_ZERO, False),
    Row("steps of the port", _torque, dead_band.steps_of_the_port, _FINER_PORT, False),
    Row("torque port against drive", _torque, torque.port_against_drive, _LOOK_AT_PORT, False),
    Row("torque against inertia", _torque, inertia.torque_against_inertia, _LOOK_AT_SCALE, False),
    Row("origin of the tare", _tare, tare.origin, _SAME_RIG),
    Row("age of the tare", _tare, tare.age, _NEW_TARE),
    Row("temperature of the tare", _tare, tare.temperature, _SAME_ROOM),
    Row("size of the tare", _tare, tare.size, _LOOK_AT_PORT),
    Row("shape of the tare", _tare, tare.shape, _TARE_AGAIN, False),
    Row("card of the motor", _tare, tare.card, _TARE_AGAIN, False),
    Row("other tares of the bench", _tare, tare.others, _TARE_AGAIN, False),
)


def checks_of(recorded: Recorded) -> Evidence:
    """The evidence with what the table found of the recording, and the tare as wide as the checks make it.

    Raises `AnalysisError` that names the check which refuses.
    """
    evidence = recorded.evidence
    checks: list[Finding] = []
    for row in TABLE:
        if not row.concerns(recorded):
            continue
        found = row.named(row.look(recorded))
        if found.severity is Severity.BLOCKS:
            raise AnalysisError(
                f"{found.what}: {found.follows}",
                where=recorded.recording.metadata.run_id,
                value=found.found,
                limit=found.allowed,
                remedy=found.remedy,
            )
        checks.append(found)
    settings = {name: v for name, v in evidence.settings.items() if name not in SETTINGS}
    return dataclasses.replace(
        evidence, checks=tuple(checks), tare=tare.widened(recorded), settings=settings
    )
