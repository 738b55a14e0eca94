"""Parameter files of a gear: TOML that a person can edit, with the source beside every number.

A file has `format`, `name`, one table per section of `HarmonicDrive`, the series of the kinematic
error (equation 16) and the model's options. `gear_to_mapping` is the same content as plain data in
SI, as run files keep it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_args, get_type_hints

from model import quantities
from model.errors import ParameterError
from model.gear import Harmonic, HarmonicDrive, ModelOptions, Origin
from model.sections import (
    Bearing,
    Cup,
    Damping,
    Geometry,
    Inertia,
    Material,
    MeshFriction,
    Ratings,
    Section,
    Teeth,
    Tooth,
)
from model.toml_text import toml_value
from model.units import DEGREE

FORMAT = "harmonic-drive-1"
"""The value of `format` in the files that this program reads and writes."""

SECTIONS: dict[str, type[Section]] = {
    "teeth": Teeth,
    "geometry": Geometry,
    "material": Material,
    "tooth": Tooth,
    "cup": Cup,
    "bearing": Bearing,
    "inertia": Inertia,
    "damping": Damping,
    "mesh_friction": MeshFriction,
    "ratings": Ratings,
}
"""The tables of a gear file in their order, and the section that each becomes."""

_LARGEST_HARMONIC = DEGREE
"""rad; a kinematic error beyond a degree is a wrong unit, not a gear."""

_TOP = ("format", "name", *SECTIONS, "kinematic_error", "options")
_HARMONIC_KEYS = ("order", "cosine", "sine", "unit", "provenance", "source", "standard_uncertainty")


def shipped_gear(name: str = "csf-25-120") -> HarmonicDrive:
    """A gear that comes with the program; raises `ParameterError` for an unknown name, listing those there are."""
    return gear_from_mapping(quantities.read_shipped("gear", name), f"{name}.toml")


def load_gear(path: str | Path) -> HarmonicDrive:
    """The gear of a parameter file; raises `ParameterError` with file, path of the value, value and allowed range."""
    return gear_from_mapping(quantities.read_toml(path), str(path))


def save_gear(gear: HarmonicDrive, path: str | Path) -> None:
    """Write a parameter file that reads back to exactly this gear."""
    quantities.write_text(gear_to_toml(gear), path)


def gear_from_mapping(mapping: Mapping[str, Any], where: str) -> HarmonicDrive:
    """The gear of plain data (a parsed TOML file, or what `gear_to_mapping` made); `where` names it in messages."""
    try:
        return _gear(mapping)
    except ParameterError as error:
        raise quantities.within(error, where) from error


def gear_to_mapping(gear: HarmonicDrive) -> dict[str, Any]:
    """The gear as plain JSON-able data in SI: every value with unit, provenance, source and uncertainty."""
    mapping: dict[str, Any] = {"format": FORMAT, "name": gear.name}
    for name in SECTIONS:
        mapping[name] = {}
    for value in gear.values():
        section, _, quantity = value.path.partition(".")
        mapping[section][quantity] = quantities.entry_of(value.value, value.unit, value.origin)
    orders: list[dict[str, Any]] = []
    for harmonic in gear.kinematic_error:
        entry = quantities.entry_of(
            0.0, "rad", gear.origins.get(harmonic_path(harmonic.order), Origin("assumed"))
        )
        del entry["value"]
        orders.append(
            {"order": harmonic.order, "cosine": harmonic.cosine, "sine": harmonic.sine, **entry}
        )
    mapping["kinematic_error"] = {"orders": orders}
    mapping["options"] = dataclasses.asdict(gear.options)
    return mapping


def gear_to_toml(gear: HarmonicDrive) -> str:
    """The gear as the text of a parameter file, in readable units that convert back to exactly the same numbers."""
    lines = [
        "# Parameters of a harmonic drive. Every line holds value, unit, provenance and "
        "source; change what you know better.",
        f"format = {quantities.quote(FORMAT)}",
        f"name = {quantities.quote(gear.name)}",
    ]
    for name, kind in SECTIONS.items():
        origins = {
            path.partition(".")[2]: o
            for path, o in gear.origins.items()
            if path.startswith(f"{name}.")
        }
        heading = (kind.__doc__ or "").split("\n")[0]
        lines += [
            "",
            f"# {heading}",
            f"[{name}]",
            *quantities.section_lines(getattr(gear, name), origins),
        ]
    series = "# The kinematic error (equation 16): cosine and sine amplitudes per order of the input angle."
    lines += ["", series, "[kinematic_error]"]
    lines += [
        "orders = [",
        *(_harmonic_line(gear, harmonic) for harmonic in gear.kinematic_error),
        "]",
    ]
    lines += [
        "",
        "# The choices where the published model is silent or contradicts itself.",
        "[options]",
    ]
    for option, chosen in dataclasses.asdict(gear.options).items():
        lines.append(f"{option} = {toml_value(chosen)}{_choices(option)}")
    return "\n".join(lines) + "\n"


def harmonic_path(order: float) -> str:
    """The key of one order of the kinematic error in `HarmonicDrive.origins`."""
    return f"kinematic_error.{order:.12g}"


def _gear(mapping: object) -> HarmonicDrive:
    """The gear of plain data, with paths relative to it in the messages."""
    if not quantities.is_table(mapping):
        raise ParameterError("is not a parameter set", value=quantities.shorten(mapping))
    if mapping.get("format") != FORMAT:
        remedy = "Is this the parameter file of a gear?"
        marker = quantities.shorten(mapping.get("format"))
        raise ParameterError(
            "is not the format of a gear",
            where="format",
            value=marker,
            limit=f'"{FORMAT}"',
            remedy=remedy,
        )
    quantities.check_keys(mapping, _TOP, "")
    name = mapping.get("name")
    if not isinstance(name, str) or not name.strip():
        text = quantities.shorten(name)
        raise ParameterError(
            "is not a name", where="name", value=text, limit="text", remedy="Give the part number."
        )
    parts: dict[str, Any] = {}
    origins: dict[str, Origin] = {}
    for section, kind in SECTIONS.items():
        if section not in mapping:
            raise ParameterError("is missing", where=section, remedy=f"Add the table [{section}].")
        arguments, found_origins = quantities.read_section(kind, mapping[section], section)
        parts[section] = kind(**arguments)
        origins.update(
            {f"{section}.{quantity}": origin for quantity, origin in found_origins.items()}
        )
    series = _series(mapping.get("kinematic_error", {}), origins)
    options = _options(mapping.get("options", {}))
    return HarmonicDrive(
        name=name,
        **parts,
        kinematic_error=series,
        options=options,
        origins=MappingProxyType(origins),
    )


def _series(table: object, origins: dict[str, Origin]) -> tuple[Harmonic, ...]:
    """The orders of the kinematic error; their origins are added to `origins`."""
    where = "kinematic_error"
    if not quantities.is_table(table):
        raise ParameterError("is not a table", where=where, value=quantities.shorten(table))
    quantities.check_keys(table, ("orders",), where)
    rows: Sequence[object] = table.get("orders", [])
    if not isinstance(rows, (list, tuple)):
        raise ParameterError(
            "is not a list of orders", where=f"{where}.orders", value=quantities.shorten(rows)
        )
    series: dict[str, Harmonic] = {}
    for index, row in enumerate(rows):
        path = f"{where}.orders[{index}]"
        if not quantities.is_table(row):
            form = '{ order = .., cosine = .., sine = .., unit = "arcmin" }'
            raise ParameterError(
                "is not an order",
                where=path,
                value=quantities.shorten(row),
                remedy=f"Write {form}.",
            )
        harmonic, origin = _harmonic(row, path)
        key = harmonic_path(harmonic.order)
        if key in series:
            raise ParameterError(
                "is given twice",
                where=f"{path}.order",
                value=harmonic.order,
                limit="each order once",
            )
        series[key] = harmonic
        origins[key] = origin
    return tuple(series.values())


def _harmonic(row: Mapping[str, Any], path: str) -> tuple[Harmonic, Origin]:
    """One order of the series in rad, and its origin."""
    quantities.check_keys(row, _HARMONIC_KEYS, path)
    for key in ("order", "cosine", "sine", "unit"):
        if key not in row:
            raise ParameterError(
                "is missing", where=f"{path}.{key}", remedy="Give order, cosine, sine and unit."
            )
    order = quantities.number(row["order"], f"{path}.order", "> 0 cycles per input revolution")
    if not 0.0 < order <= 100_000.0:
        limit = "> 0 and <= 100000 cycles per input revolution"
        raise ParameterError("is out of range", where=f"{path}.order", value=order, limit=limit)
    if not isinstance(row["unit"], str):
        raise ParameterError(
            "is not a unit",
            where=f"{path}.unit",
            value=quantities.shorten(row["unit"]),
            limit="arcmin",
        )
    amplitudes: dict[str, float] = {}
    for key in ("cosine", "sine", "standard_uncertainty"):
        if key not in row:
            continue
        limit = f"within {_LARGEST_HARMONIC:.3g} rad (1 degree)"
        amplitude = quantities.number(row[key], f"{path}.{key}", limit)
        amplitudes[key] = quantities.to_si(amplitude, row["unit"], "rad", f"{path}.unit")
        if abs(amplitudes[key]) > _LARGEST_HARMONIC or (
            key == "standard_uncertainty" and amplitude < 0.0
        ):
            raise ParameterError(
                "is out of range",
                where=f"{path}.{key}",
                value=f"{amplitude:g} {row['unit']}",
                limit=limit,
            )
    provenance, source = quantities.read_origin(row, path)
    origin = Origin(provenance, source, amplitudes.get("standard_uncertainty"))
    return Harmonic(order, amplitudes["cosine"], amplitudes["sine"]), origin


def _harmonic_line(gear: HarmonicDrive, harmonic: Harmonic) -> str:
    """One order of the series as a line of a parameter file."""
    origin = gear.origins.get(harmonic_path(harmonic.order), Origin("assumed"))
    amplitudes = {"cosine": harmonic.cosine, "sine": harmonic.sine}
    text = quantities.entry_text(amplitudes, "rad", origin)
    return f"  {{ order = {harmonic.order!r}, {text} }},"


def _options(table: object) -> ModelOptions:
    """The model's options; a choice that does not exist is refused with those that do."""
    if not quantities.is_table(table):
        raise ParameterError("is not a table", where="options", value=quantities.shorten(table))
    hints = get_type_hints(ModelOptions)
    quantities.check_keys(table, hints, "options")
    for option, chosen in table.items():
        allowed = get_args(hints[option]) or (True, False)
        if not any(type(chosen) is type(choice) and chosen == choice for choice in allowed):
            limit = ", ".join(map(toml_value, allowed))
            text = quantities.shorten(chosen)
            raise ParameterError(
                "is no known choice", where=f"options.{option}", value=text, limit=limit
            )
    return ModelOptions(**table)


def _choices(option: str) -> str:
    """The choices of an option as a comment."""
    allowed = get_args(get_type_hints(ModelOptions)[option])
    return f"  # {' | '.join(allowed)}" if allowed else ""
