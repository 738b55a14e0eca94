"""What the facts of a run are called and in which unit they are read: for the difference of two runs, on every surface.

Parameters go by their protocol's parameter model, the facts of a gear card by its fields, figures of
the acquisition by the table below; what a file calls "speed_rpm" is "speed" in r/min everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping

from experiments import catalogue
from experiments.parameters import parameter_fields
from model.units import printed
from rig.content.wording import laboratory_unit, readable
from rig.gears.card import UNITS, in_words

ACQUISITION: Mapping[str, str] = {
    "duration": "s",
    "planned duration": "s",
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
"""SI units of the figures of an acquisition that have one."""
TEMPERATURES = "thermal_state."
"""How the names of temperatures among them begin."""
MICROSECONDS = 1e-3
"""Times shorter than this [s] are read in microseconds."""


def words_of(group: str, name: str, *protocols: str) -> tuple[str, str]:
    """Title and unit of a fact of a run by one of these protocols, as they are read."""
    if group == "parameters":
        units = [_parameter_units(protocol).get(name, "") for protocol in protocols]
        unit = next((one for one in units if one), "")
        return in_words(name), "" if unit == "1" else printed(unit)
    if group in ("conditions", "gear"):
        unit = UNITS.get(name, "")
        return in_words(name) if name in UNITS else readable(name), printed(unit)
    if group == "acquisition":
        parts = name.split(".")
        return ", ".join(readable(part).replace("_", " ") for part in parts), ""
    return readable(name), ""


def _parameter_units(protocol: str) -> Mapping[str, str]:
    experiment = catalogue.declared(protocol)
    if experiment is None:
        return {}
    return {f.name: f.unit for f in parameter_fields(experiment.parameters)}


def read_in(unit: str, value: float) -> tuple[float, str]:
    """A number in SI as it is read in a laboratory: the shown number and its unit."""
    if unit == "s" and abs(value) < MICROSECONDS:
        return value * 1e6, "µs"
    factor, shown = laboratory_unit(unit, value, "r/min" if unit == "rad/s" else "")
    return value / factor, shown.replace("degC", "°C")


def acquisition_unit(name: str) -> str:
    """SI unit of a figure of an acquisition; "" for a count."""
    return "degC" if name.startswith(TEMPERATURES) else ACQUISITION.get(name, "")
