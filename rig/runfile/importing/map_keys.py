"""The words of a channel map: every key with its kind and meaning, read from here by the reader and by the reference.

A map is TOML. What stands at the top holds for every run that is made of the file; `[runs.NAME]`
holds the same tables again for one run of several (a joint of a robot), and goes before the top.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["text", "number", "whole number", "yes or no", "text or number"]
PYTHON_KINDS: dict[Kind, tuple[type, ...]] = {
    "text": (str,),
    "number": (int, float),
    "whole number": (int,),
    "yes or no": (bool,),
    "text or number": (str, int, float),
}


@dataclass(frozen=True)
class Key:
    """One key of a table: its name there, what it may hold, what it means, and the field of the options it becomes."""

    name: str
    kind: Kind
    what: str
    field: str = ""
    is_needed: bool = False


CHANNEL_KEYS = (
    Key("column", "text or number", "heading of the column, or its number from 1", is_needed=True),
    Key(
        "unit",
        "text",
        "unit of the column's numbers; not needed where the heading or the file says it",
    ),
    Key(
        "scale",
        "number",
        "counts per revolution of an angle in `count`, N m per A (or V) of a torque in A (or V), "
        "SI units per count, seconds per tick of a time in `count`, else a factor; -1 turns the sign",
    ),
    Key("offset", "number", "added in SI"),
    Key(
        "modulus",
        "number",
        "range after which the column wraps, in its own numbers; 0: it does not",
    ),
    Key("long_name", "text", "words for axes and tables"),
    Key("file", "text", "the one of several files that holds the column: its name, stem or number"),
    Key("time", "text or number", "the channel's own column of time"),
    Key(
        "side",
        "text",
        "`input` or `output`: the column was taken there and is brought over by the ratio",
    ),
    Key(
        "accuracy", "number", "half-width of an encoder's whole error curve, SI unit of the channel"
    ),
    Key("scale_uncertainty", "number", "standard uncertainty of the scale, relative"),
    Key("offset_uncertainty", "number", "standard uncertainty of the zero, SI unit of the channel"),
    Key("lag_s", "number", "by how many seconds the channel is late"),
    Key(
        "sensor",
        "text",
        "what it comes from, with its constant; channels of one sensor are one instrument",
    ),
    Key("certificate", "text", "name of the calibration certificate"),
    Key("date", "text", "day of the calibration"),
    Key("due", "text", "day when the calibration ends"),
)
"""`[channels.NAME]`, and `[reverse.NAME]`: the same channel for the second half of the rows, where
a table has forward and reverse as columns of one row."""

SEGMENT_KEYS = (
    Key("label", "text", "what it is: `traverse`, `hold`, `step`, `rest`, ...", is_needed=True),
    Key("start", "number", "seconds since the first row", is_needed=True),
    Key("stop", "number", "seconds since the first row, not included", is_needed=True),
    Key("setpoint", "number", "what it was set to, SI (speed of the input in rad/s)"),
    Key("direction", "whole number", "+1 forward, -1 reverse, 0 neither"),
    Key("repeat", "whole number", "number of the repeat, from 0"),
)
"""`[[segments]]`"""

SEGMENTS_FROM_KEYS = (
    Key("column", "text or number", "a column whose value or word labels the rows"),
    Key("file", "text", "the one of several files that holds the column"),
    Key(
        "setpoint",
        "text",
        "a channel of set-points: each stretch at one value other than 0 is a segment",
    ),
    Key("label", "text", "label of the stretches at one set-point (`traverse`)"),
    Key("least_s", "number", "shortest stretch that counts, in seconds (0.5)"),
)
"""`[segments_from]`; its table `labels` gives a label for each word of the column, and rows with other words none."""

RECORDING_KEYS = (
    Key("rate", "number", "sample rate in Hz, where there is no column of time", "rate"),
    Key(
        "speed",
        "text or number",
        "speed of the input with its unit, of a log at constant speed that has no angle",
        "speed",
    ),
    Key("no_time", "yes or no", "there is no time base", "no_time"),
    Key("time_base", "text", "what stamped the rows: hardware, device, host, nominal", "time_base"),
    Key("start", "text", "when the first row was recorded, ISO 8601", "start_time"),
    Key(
        "drop_bad_rows",
        "yes or no",
        "leave out rows with holes, count and list them",
        "drop_bad_rows",
    ),
    Key("torque_constant", "number", "N m per A, for torques given in A", "torque_constant"),
    Key("delimiter", "text", "between the columns of a text", "delimiter"),
    Key("decimal", "text", "decimal mark of a text", "decimal"),
    Key("skip", "whole number", "lines at the beginning that are not looked at", "skip"),
    Key("header", "whole number", "the line that holds the headings, from 1", "header"),
    Key("ragged", "yes or no", "lines may end early", "is_ragged"),
    Key("interpolate", "yes or no", "bring channels onto the times of the first", "interpolate"),
    Key(
        "gap",
        "number",
        "steps of the time longer than so many usual ones are gaps, across which nothing is interpolated (1.5)",
        "gap",
    ),
    Key(
        "allow_jumps", "yes or no", "angles that jump as if they were wrapped are so", "allow_jumps"
    ),
    Key("ignore_headings", "yes or no", "units in headings are not believed", "ignore_headings"),
    Key("protocol", "text", "the protocol or analysis that it is for", "experiment"),
    Key("title", "text", "what it is, in a few words", "title"),
    Key("operator", "text", "who recorded it", "operator"),
)
"""`[recording]`"""

_FORM = ("delimiter", "decimal", "skip", "header", "ragged")
FILE_KEYS = (
    *(key for key in RECORDING_KEYS if key.name in _FORM),
    Key(
        "time_unit",
        "text",
        "unit of the file's column of time, where its heading does not say it",
        "time_unit",
    ),
)
"""`[files.NAME]`: one of several files of a run, by name, stem or number; goes before `[recording]`."""

GEAR_KEYS = (
    Key("serial", "text", "serial number of the gear, or name of the joint", "gear_serial"),
    Key("ratio", "number", "input revolutions per output revolution", "ratio"),
    Key("mounting", "text", "circular-spline-fixed or flexspline-fixed", "mounting"),
    Key("output_sense", "whole number", "+1 or -1: the output angle counts with or against the input", "output_sense"),
    Key("mounted", "yes or no", "no: the gear was taken off, the motor ran alone", "gear_mounted"),
    Key("resonance_hz", "number", "known first resonance in Hz", "resonance_hz"),
    Key("load_inertia_kg_m2", "number", "inertia on the output in kg m2", "load_inertia_kg_m2"),
)  # fmt: skip
"""`[gear]`"""

TABLES = {
    "channels": CHANNEL_KEYS,
    "reverse": CHANNEL_KEYS,
    "segments": SEGMENT_KEYS,
    "segments_from": SEGMENTS_FROM_KEYS,
    "recording": RECORDING_KEYS,
    "files": FILE_KEYS,
    "gear": GEAR_KEYS,
}
CONDITIONS, RUNS = "conditions", "runs"
"""`[conditions]`: any name with a text or a number; `[runs.NAME]`: a map for one run of several."""

LABELS = {
    "traverse": "the input turns at constant speed, long enough for whole revolutions: kinematic error, orders",
    "hold": "a speed is held until the torque is steady: friction, warm-up",
    "step": "the speed rises at once from standstill: velocity steps",
    "approach": "the way to a traverse, from its own side; not analysed",
    "ramp": "the speed changes; not analysed",
    "settle": "a speed is held and the torque still changes; not analysed",
    "warm-up": "turning until the torque is steady",
    "torque-ramp": "the torque rises slowly until the input moves: starting torque",
    "position": "a wave-generator angle is gone to",
    "rest": "standstill between steps; a step that follows is shown with the end of it",
    "bracket": "the reference speed that is visited again and again: what drifts",
    "torque-zero-before": "drive off, nothing moves: zero of the torque, before",
    "torque-zero-after": "the same, after",
}
"""Labels that analyses look for; any other may stand beside them."""
