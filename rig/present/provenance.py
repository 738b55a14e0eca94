"""Where a report's numbers come from: the identity of every run, the conditions that prevailed, how it was analysed."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from experiments import catalogue
from model.units import printed
from rig.analysis.fit import NOT_SEALED
from rig.content.wording import number, readable
from rig.present.run_words import world_facts

if TYPE_CHECKING:
    from drivers.channel import Calibration
    from experiments.recording import Recording
    from model.gear import HarmonicDrive
    from rig.analysis.fit import Fit


@dataclass(frozen=True)
class Provenance:
    """Where one run comes from."""

    rows: tuple[tuple[str, str], ...] = ()
    conditions: tuple[tuple[str, str], ...] = ()
    settings: tuple[tuple[str, str], ...] = ()
    options: tuple[tuple[str, str], ...] = ()
    calibrations: tuple[tuple[str, str], ...] = ()
    alarms: tuple[str, ...] = ()
    """What makes the run's scales doubtful: calibrations that had expired, or of hardware that has none."""


@dataclass(frozen=True)
class Matrix:
    """The same facts of several runs side by side: one column per run, one row per fact."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[str, ...]], ...]


MATRIX_COLUMNS = 4
"""Runs that fit side by side on A4."""


def side_by_side(
    facts: Sequence[tuple[str, tuple[tuple[str, str], ...]]], caption: str = ""
) -> tuple[Matrix, ...]:
    """Facts of several runs (heading, names and texts) side by side, at most four to a table; empty
    ones are left out.
    """
    facts_by_run = [(heading, dict(rows)) for heading, rows in facts if rows]
    tables = []
    for first in range(0, len(facts_by_run), MATRIX_COLUMNS):
        columns = facts_by_run[first : first + MATRIX_COLUMNS]
        names = list(dict.fromkeys(name for _, facts_of_run in columns for name in facts_of_run))
        rows = tuple(
            (name, tuple(facts_of_run.get(name, "–") for _, facts_of_run in columns))
            for name in names
        )
        tables.append(Matrix(caption, tuple(heading for heading, _ in columns), rows))
    return tuple(tables)


def conditions_of(recording: Recording, gear: HarmonicDrive | None) -> tuple[tuple[str, str], ...]:
    """What prevailed during a run: speeds, duration, temperatures, load inertia (of a known gear),
    and what was noted.
    """
    import numpy as np

    rows = _setpoints(recording)
    if recording.rows > 1:
        seconds = float(recording.time(slice(recording.rows - 1, recording.rows))[0])
        rows.append(("Duration", f"{number(seconds)} s in {number(recording.rows)} cycles"))
    rate = recording.metadata.sample_rate
    if np.isfinite(rate):
        rows.append(
            ("Sampling", f"{number(float(rate))} Hz; time base: {recording.metadata.time_base}")
        )
    rows.append(("Incomplete cycles", _missed(recording)))
    for channel, words in (
        ("housing_temperature", "Housing temperature"),
        ("ambient_temperature", "Ambient temperature"),
    ):
        if recording.has(channel):
            rows.append((words, _range(recording, channel, "°C")))
    if gear is not None:
        rows.append(_load_inertia(gear))
    rows.extend(
        _condition(str(k), value_in_words(v)) for k, v in recording.metadata.conditions.items()
    )
    return tuple(rows)


def _condition(name: str, text: str) -> tuple[str, str]:
    """A condition that was noted; one of a gear card with the unit of its field, which its name
    carries only in files.
    """
    from rig.gears.card import UNITS, in_words

    unit = UNITS.get(name, "")
    words = in_words(name) if name in UNITS else readable(name)
    return (
        words.capitalize(),
        f"{text} {printed(unit)}".strip() if text else text,
    )


def _setpoints(recording: Recording) -> list[tuple[str, str]]:
    """What the rig was set to: speeds of the input, or places of the wave generator."""
    from model.units import DEGREE, RPM

    turning = [s for s in recording.segments if s.direction]
    both = ", both directions" if {s.direction for s in turning} >= {1, -1} else ""
    experiment = catalogue.declared(recording.metadata.experiment)
    if experiment is not None and experiment.setpoint == "position":
        places = sorted({round(s.setpoint / DEGREE, 3) for s in turning})
        if not places:
            return []
        span = (
            f"{number(places[0])}°"
            if len(places) == 1
            else f"{len(places)} from {number(places[0])} to {number(places[-1])}°"
        )
        return [("Wave-generator positions", span + both)]
    speeds = [abs(s.setpoint) / RPM for s in turning if s.setpoint]
    if not speeds:
        return []
    low, high = number(min(speeds)), number(max(speeds))
    return [("Input speeds", (f"{low} r/min" if low == high else f"{low} to {high} r/min") + both)]


def _load_inertia(gear: HarmonicDrive) -> tuple[str, str]:
    inertia = gear.value("inertia.output")
    source = f"{inertia.origin.provenance}: {inertia.origin.source}".rstrip(": ")
    return "Load inertia J_o", f"{number(inertia.value)} kg m² ({source})"


def _gear(fit: Fit) -> str:
    m = fit.recording.metadata
    if not m.gear_mounted:
        return "none mounted"
    return f"{fit.gear.name if fit.gear_known else 'not stated'}, serial {m.gear_serial or 'not stated'}"


def _missed(recording: Recording) -> str:
    missed = sum(int((recording.flags(block) & 1 != 0).sum()) for block in recording.blocks())
    return f"{number(missed)} of {number(recording.rows)}"


def _range(recording: Recording, channel: str, unit: str) -> str:
    import numpy as np

    low, high = np.inf, -np.inf
    for block in recording.blocks():
        values = recording.si(channel, block)
        values = values[np.isfinite(values)]
        if len(values):
            low, high = min(low, float(values.min())), max(high, float(values.max()))
    if low > high:
        return "not recorded"
    return f"{low:.1f} to {high:.1f} {unit}" if high - low >= 0.05 else f"{low:.1f} {unit}"


def value_in_words(value: Any) -> str:
    """A value of a run file as people read it; what holds others as a list of them."""
    if isinstance(value, Mapping):
        return "; ".join(f"{readable(str(k))}: {value_in_words(v)}" for k, v in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(value_in_words(v) for v in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return number(value, 6)


def provenance_of(fit: Fit) -> Provenance:
    """The run's identity and how it was analysed."""
    m = fit.recording.metadata
    rows = [
        ("Run", m.run_id),
        ("Protocol", m.experiment or "none (recording from another rig)"),
        ("Origin", m.origin),
        ("Outcome of the run", m.outcome or "not stated"),
        ("Started", _moment(m.start_time)),
        ("Ended", _moment(m.end_time)),
        ("Operator", m.operator or "not stated"),
        ("Gear", _gear(fit)),
        ("Mounting", m.mounting.replace("-", " ") if m.gear_mounted else "none"),
        ("File", fit.path.name if fit.path else "in memory"),
        ("Analysis", fit.stored or "not stored"),
        ("Tare", tare_of(fit)),
    ]
    rows.extend(
        (
            readable(str(key)).capitalize(),
            f"{value_in_words(value)} s" if key.endswith("_duration") else value_in_words(value),
        )
        for key, value in _process(m.process)
    )
    rows.extend((name.capitalize(), text) for name, text in world_facts(m.process.get("world")))
    settings = parameters_in_words(m.experiment, {**m.parameters, **fit.settings})
    options = tuple((readable(str(k)), _option(str(k), v)) for k, v in fit.result.options.items())
    return Provenance(
        tuple(rows),
        conditions_of(fit.recording, fit.gear if fit.gear_known and m.gear_mounted else None),
        settings,
        options,
        calibrations_of(fit.recording),
        alarms_of(fit.recording),
    )


def tare_of(fit: Fit) -> str:
    """The tare that was subtracted, in words: its run, or none; of a stored analysis as it says itself."""
    if fit.tare is not None:
        return f"run {fit.tare.recording.metadata.run_id}"
    named = str(fit.result.options.get("tare_run") or "none")
    return "none" if named == "none" else f"run {named}"


EXPIRED = "EXPIRED WHEN THE RUN BEGAN"


def calibrations_of(recording: Recording) -> tuple[tuple[str, str], ...]:
    """Certificate, date and due date of every calibrated channel, and loudly whether it had expired
    when the run began.
    """
    rows = []
    for name, calibration in _calibrated(recording):
        c = calibration
        parts = [
            c.certificate or "no certificate",
            f"of {c.date}" if c.date else "",
            f"due {c.due}" if c.due else "",
        ]
        text = ", ".join(part for part in parts if part) + (
            f": {EXPIRED}" if _expired(recording, c) else ""
        )
        rows.append((name, text))
    return tuple(rows)


def alarms_of(recording: Recording) -> tuple[str, ...]:
    """Sentences for the top of the report: a file without a seal, expired calibrations, and
    channels of hardware without a certificate.
    """
    sentences = [] if recording.metadata.is_sealed else [NOT_SEALED]
    for name, c in _calibrated(recording):
        if _expired(recording, c):
            sentences.append(
                f"The calibration of {name.lower()} ({c.certificate or 'no certificate'}) was "
                f"due on {c.due}: {EXPIRED}."
            )
        elif recording.metadata.origin == "hardware" and not c.certificate:
            sentences.append(f"{name} has no calibration certificate.")
    return tuple(sentences)


def _calibrated(recording: Recording) -> list[tuple[str, Calibration]]:
    columns = getattr(recording.source, "columns", ())
    calibrations = [(column.name, column.channel.calibration) for column in columns]
    return [
        (readable(n).capitalize(), c)
        for n, c in calibrations
        if c.certificate or c.date or c.due or n in CALIBRATED
    ]


def _expired(recording: Recording, calibration: Calibration) -> bool:
    begun = recording.metadata.start_time[:10]
    return bool(calibration.due and begun and calibration.due[:10] < begun)


CALIBRATED = frozenset({"input_angle", "output_angle", "torque"})
"""Channels whose certificate is asked for even where there is none."""


OPTION_UNITS = {"phase_reference_angle": "rad"}
"""SI units of the conventions that are quantities."""


def _option(name: str, value: Any) -> str:
    return f"{value_in_words(value)} {OPTION_UNITS.get(name, '')}".rstrip()


def _moment(text: str) -> str:
    """A time as it is read: date and time to the second, with its zone."""
    return re.sub(r"(?<=:\d\d)[.]\d+", "", text).replace("T", " ", 1) or "not stated"


def parameters_in_words(protocol: str, values: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    """Parameters of a protocol and settings of an analysis, with the units of the protocol's parameter model."""
    from experiments.parameters import parameter_fields

    units: dict[str, str] = {}
    experiment = catalogue.declared(protocol)
    if experiment is not None:
        units = {f.name: f.unit for f in parameter_fields(experiment.parameters)}
    rows = []
    for name, value in values.items():
        unit = units.get(name, "")
        text = value_in_words(value)
        rows.append(
            (
                readable(str(name)).removesuffix(" rpm"),
                f"{text} {printed(unit)}" if unit not in ("", "1") and text else text,
            )
        )
    return tuple(rows)


def _process(process: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """What the run file says about how it was made, without long texts and the truth of a simulated rig."""
    return [
        (k, v)
        for k, v in process.items()
        if k not in ("truth", "experiment", "parameters")
        and not isinstance(v, Mapping)
        and len(str(v)) <= 200
    ]
