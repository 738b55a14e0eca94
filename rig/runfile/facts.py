"""The facts of a run in words, flattened once: lists, pages and comparisons choose among them by their group.

A number whose unit follows from its name, or from the parameters of its protocol, has it beside it (`Fact.unit`); one
that is read by its size has it in its value. All digits are kept, as they are typed: what differs is seen to differ.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from hashlib import sha256
from typing import Any

from experiments import catalogue
from experiments.parameters import parameter_fields
from experiments.recording import Recording, RunMetadata
from model.units import printed
from rig.content.grid import Fact
from rig.content.phrase import phrase
from rig.content.wording import named, quantity_text, value_text
from rig.program import EXTENSIONS, PROGRAM_KEYS, brought_by

GROUPS = (
    "run",
    "parameters",
    "limits",
    "gear",
    "conditions",
    "calibrations",
    "versions",
    "acquisition",
)
"""What a run says of itself, in this order."""
ELSEWHERE = frozenset({"truth", "acquisition", "planned_duration", "experiment", "parameters"})
"""What the file keeps of the process that stands in a group of its own, or is the truth of a simulation, which no rig
tells.
"""
TEMPERATURES = ("housing_temperature", "ambient_temperature")
FIGURES: Mapping[str, str] = {
    "duration": "s",
    "sample rate": "Hz",
    "nominal_rate": "Hz",
    "achieved_rate": "Hz",
    "jitter_rms": "s",
    "jitter_p99": "s",
    "jitter_max": "s",
    "torque_port_against_drive.offset": "N m",
    "torque_port_against_drive.scatter": "N m",
    "torque_port_against_drive.worst": "N m",
}
"""SI units of the figures of an acquisition that have one; those of its thermal state are degC."""


def run_facts(recording: Recording) -> tuple[Fact, ...]:
    """Everything that a run says of itself, by `GROUPS`; reads its temperatures from end to end."""
    m = recording.metadata
    process = {name: value for name, value in m.process.items() if name not in ELSEWHERE}
    program = {name: process.pop(name) for name in PROGRAM_KEYS if name in process}
    for number, one in enumerate(brought_by({EXTENSIONS: process.pop(EXTENSIONS, ())}), 1):
        program[f"another package {number}"] = one
    acquired = {"origin": m.origin, "time base": m.time_base, "sample rate": m.sample_rate}
    acquired |= process | dict(figures_of(m.process.get("acquisition")))
    run = {"run": m.run_id, "start": m.start_time, "end": m.end_time, "outcome": m.outcome}
    return (
        *flat("run", run | {"rows": recording.rows, "file": m.seal}),
        *parameter_facts(m.experiment, {"protocol": m.experiment, **m.parameters}),
        *limit_facts(m.limits),
        *_gear_facts(m),
        *flat("conditions", {"operator": m.operator, **m.conditions}),
        *_mean_temperatures(recording),
        *_calibration_facts(recording),
        *flat("versions", program),
        *flat("acquisition", acquired),
    )


def figures_of(value: object) -> Mapping[str, Any]:
    """A group of figures as a run keeps them; empty for what is none."""
    return value if isinstance(value, Mapping) else {}


def flat(
    group: str, nested: Mapping[str, Any], units: Mapping[str, str] | None = None, prefix: str = ""
) -> Iterator[Fact]:
    """A mapping of mappings as facts with dotted names; `units` of the names, where their endings do not say it."""
    for key, value in nested.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping) and not {"value", "expanded_uncertainty"} <= value.keys():
            yield from flat(group, value, units, f"{name}.")
            continue
        words = [named(part) for part in ([name] if " " in name else name.split("."))]
        unit = words[-1][1] if units is None else units.get(name, "")
        unit = "" if unit == "1" else printed(unit)
        text = _text(name, value) if isinstance(value, Mapping) or not unit else plain(value)
        yield Fact(", ".join(part for part, _ in words), text, unit, group, name)


def parameter_facts(protocol: str, values: Mapping[str, Any]) -> Iterator[Fact]:
    """Parameters of a protocol, and settings of its analysis, with the units of its parameter model."""
    experiment = catalogue.declared(protocol)
    if experiment is None:
        return flat("parameters", values)
    fields = parameter_fields(experiment.parameters)
    units = {field.name: field.unit for field in fields}
    files = [field.name for field in fields if field.content and values.get(field.name)]
    short = {name: content_in_words(str(values[name])) for name in files}
    return flat("parameters", {**values, **short}, units)


def content_in_words(content: str) -> str:
    """A parameter that is the content of a file, where it is named and not shown."""
    return f"{len(content.splitlines())} lines, SHA-256 {sha256(content.encode()).hexdigest()[:12]}"


def limit_facts(limits: Mapping[str, Any]) -> Iterator[Fact]:
    """Every limit that held: its value, and where it is from."""
    for name, limit in limits.items():
        text = plain(limit)
        if isinstance(limit, Mapping) and isinstance(limit.get("value"), (int, float)):
            text = quantity_text(limit["value"], str(limit.get("unit", "")))
            said = [str(limit[key]) for key in ("tier", "origin", "provenance") if limit.get(key)]
            text += phrase(" ({})", ", ".join(said))
        yield Fact(named(name)[0], text, "", "limits", name)


def plain(value: Any) -> str:
    """A value of a file in words; numbers as they are typed, what holds others as a list of them."""
    if value is None:
        return "not stated"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, Mapping):
        return "; ".join(f"{named(str(key))[0]}: {plain(one)}" for key, one in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(plain(one) for one in value)
    return str(value)


def _text(name: str, value: Any) -> str:
    if isinstance(value, Mapping):
        doubt = value["expanded_uncertainty"]
        if value["value"] is None:
            return plain(None)
        return value_text(value["value"], doubt, str(value.get("unit", "1")))
    unit = "degC" if name.startswith("thermal_state.") else FIGURES.get(name, "")
    if unit and isinstance(value, (int, float)):
        return quantity_text(value, unit)
    return plain(value)


def _gear_facts(m: RunMetadata) -> Iterator[Fact]:
    facts: dict[str, Any] = {
        "serial number": m.gear_serial,
        "mounted": m.gear_mounted,
        "mounting": m.mounting_said,
        "ratio": m.ratio,
    }
    if m.gear is not None:
        facts["part"] = m.gear.name
        facts |= {
            value.path: f"{quantity_text(value.value, value.unit)} ({value.origin.provenance})"
            for value in m.gear.values()
        }
        facts |= {f"option {name}": str(value) for name, value in vars(m.gear.options).items()}
    return flat("gear", facts)


def _calibration_facts(recording: Recording) -> Iterator[Fact]:
    for column in getattr(recording.source, "columns", ()):
        channel, c = column.channel, column.channel.calibration
        facts = {
            "instrument": " ".join(one for one in (channel.model, channel.serial_number) if one),
            "scale": f"{plain(channel.gain)} {channel.unit}",
            "offset": f"{plain(channel.offset)} {channel.unit}",
            "certificate": ", ".join(one for one in (c.certificate, c.date, c.due) if one),
            "relative uncertainty of the scale": _value_text(c.scale_relative_uncertainty),
            "uncertainty of the offset": _value_text(c.offset_uncertainty, channel.unit),
            "accuracy": _value_text(c.accuracy, channel.unit),
        }
        yield from flat("calibrations", {f"{channel.name} {what}": t for what, t in facts.items()})


def _value_text(value: float | None, unit: str = "") -> str:
    if value is None:
        return plain(value)
    return f"{plain(value)} {unit}".rstrip()


def temperature_ranges(recording: Recording) -> dict[str, tuple[float, float, float]]:
    """Least, mean and largest value of every temperature that was recorded [°C], without what is no number."""
    import numpy as np

    ranges = {}
    for name in TEMPERATURES:
        if not recording.has(name):
            continue
        low, high, total, count = np.inf, -np.inf, 0.0, 0
        for rows in recording.blocks():
            values = recording.si(name, rows)
            values = values[np.isfinite(values)]
            if len(values):
                low, high = min(low, float(values.min())), max(high, float(values.max()))
                total, count = total + float(values.sum()), count + len(values)
        ranges[name] = (low, total / count if count else np.nan, high)
    return ranges


def _mean_temperatures(recording: Recording) -> Iterator[Fact]:
    for name, (_, mean, _) in temperature_ranges(recording).items():
        title = f"mean {named(name)[0]}"
        yield Fact(title, f"{mean:.1f} °C", "", "conditions", title)
