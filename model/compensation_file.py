"""The file of a compensation table (TOML): angles in arcseconds at the output, speeds in r/min, read strictly.

format = "harmonic-rig-compensation-1"
gear = "G-1"
ratio = 120
index_gap = 0.41

[forward]
labels = ["2", "1/N"]
cosine_arcsec = [13.1, 0.4]
"""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from model.compensation import CompensationTable, DirectionTable, Proof
from model.errors import ModelError
from model.quantities import is_table
from model.toml_text import toml_value
from model.units import ARCSEC, RPM

FORMAT: Final = "harmonic-rig-compensation-1"
_DIRECTIONS = ("forward", "reverse")
_NUMBERS = ("cosine_arcsec", "sine_arcsec", "encoder_arcsec")
_COVARIANCE = ("variance_cosine_arcsec2", "covariance_arcsec2", "variance_sine_arcsec2")
_TOP: dict[str, type] = {
    "format": str,
    "gear": str,
    "part": str,
    "mounting": str,
    "ratio": float,
    "sense": int,
    "bench": str,
    "origin": str,
    "encoder": str,
    "learnt": str,
    "index_gap": float,
    "slowest_rpm": float,
    "fastest_rpm": float,
    "temperature": float,
    "runs": list,
}
_AS_THEY_ARE = (
    "gear",
    "part",
    "mounting",
    "ratio",
    "sense",
    "bench",
    "origin",
    "encoder",
    "learnt",
)
_OPTIONAL = ("temperature", "index_gap", "proof")
_PROOF: dict[str, type] = {
    "run": str,
    "verdict": str,
    "speed_rpm": float,
    "ratio": float,
    "low": float,
    "high": float,
    "removed": float,
    "helps_up_to_rpm": float,
    "harms_from_rpm": float,
}
_PROOF_OPTIONAL = ("helps_up_to_rpm", "harms_from_rpm")


def compensation_text(table: CompensationTable) -> str:
    """The file of a table; it reads back to the same numbers within 1e-12 of an arcsecond."""
    top: dict[str, object] = {
        "format": FORMAT,
        "gear": table.gear,
        "part": table.part,
        "mounting": table.mounting,
        "ratio": table.ratio,
        "sense": table.sense,
        "bench": table.bench,
        "origin": table.origin,
        "encoder": table.encoder,
        "learnt": table.learnt,
        "index_gap": table.index_gap,
        "slowest_rpm": table.speed[0] / RPM,
        "fastest_rpm": table.speed[1] / RPM,
        "temperature": table.temperature,
        "runs": table.runs,
    }
    lines = _keys(top)
    for name, way in ((name, getattr(table, name)) for name in _DIRECTIONS):
        lines += ["", f"[{name}]", *_keys(_direction(way))]
    if table.proof is not None:
        lines += ["", "[proof]", *_keys(_proof(table.proof))]
    return "\n".join(lines) + "\n"


def compensation_from(text: str, where: str = "compensation table") -> CompensationTable:
    """The table of the text of its file. Raises `ModelError` that names file, key, value and what is allowed."""
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ModelError(
            "is no TOML",
            where=where,
            value=str(error),
            remedy="A table is made by `rig compensate RUN...`.",
        ) from None
    top = _checked(content, _TOP, (*_DIRECTIONS, "proof"), _OPTIONAL, where)
    if top["format"] != FORMAT:
        raise ModelError(
            "is of another format", where=f"{where}.format", value=top["format"], limit=FORMAT
        )
    if not top["ratio"] > 1.0 or top["sense"] not in (-1, 1):
        raise ModelError("is none", where=f"{where}.ratio, sense", value=f"{top['ratio']:g}")
    proof = content.get("proof")
    return CompensationTable(
        **{name: top[name] for name in _AS_THEY_ARE},
        index_gap=top.get("index_gap"),
        speed=(top["slowest_rpm"] * RPM, top["fastest_rpm"] * RPM),
        temperature=top.get("temperature"),
        runs=tuple(map(str, top["runs"])),
        forward=_read_direction(content.get("forward"), f"{where}.forward"),
        reverse=_read_direction(content.get("reverse"), f"{where}.reverse"),
        proof=None if proof is None else _read_proof(proof, f"{where}.proof"),
    )


def _direction(way: DirectionTable) -> dict[str, object]:
    columns = (way.cosine, way.sine, way.encoder)
    found: dict[str, object] = {"labels": way.labels}
    found |= {name: _scaled(c, ARCSEC) for name, c in zip(_NUMBERS, columns, strict=True)}
    blocks = np.array(way.covariance).reshape(-1, 3).T
    found |= {n: _scaled(c, ARCSEC**2) for n, c in zip(_COVARIANCE, blocks, strict=True)}
    return found | {"degrees_of_freedom": way.freedom, "rest_arcsec": way.rest / ARCSEC}


def _scaled(values: Any, unit: float) -> list[float]:
    return [float(f"{value / unit:.12g}") for value in values]


def _read_direction(content: object, where: str) -> DirectionTable:
    kinds = {"labels": list, "degrees_of_freedom": float, "rest_arcsec": float}
    kinds |= dict.fromkeys((*_NUMBERS, *_COVARIANCE), list)
    found = _checked(content, kinds, (), (), where)
    labels = tuple(map(str, found["labels"]))
    columns = {
        name: _column(found[name], len(labels), f"{where}.{name}")
        for name in kinds
        if name in _NUMBERS + _COVARIANCE
    }
    if len(set(labels)) < len(labels):
        raise ModelError("has an order twice", where=f"{where}.labels", value=", ".join(labels))
    cosine, sine, encoder = ([v * ARCSEC for v in columns[n]] for n in _NUMBERS)
    blocks = zip(*([v * ARCSEC**2 for v in columns[name]] for name in _COVARIANCE), strict=True)
    return DirectionTable(
        labels=labels,
        cosine=tuple(cosine),
        sine=tuple(sine),
        covariance=tuple(blocks),
        encoder=tuple(encoder),
        freedom=found["degrees_of_freedom"],
        rest=found["rest_arcsec"] * ARCSEC,
    )


def _column(values: list[Any], rows: int, where: str) -> list[float]:
    is_number = [isinstance(v, (int, float)) and math.isfinite(v) for v in values]
    if len(values) != rows or not all(is_number):
        raise ModelError(
            "are not a number for each label", where=where, value=values, limit=str(rows)
        )
    return [float(v) for v in values]


def _proof(proof: Proof) -> dict[str, object]:
    helps, harms = proof.helps_up_to, proof.harms_from
    return {
        "run": proof.run,
        "verdict": proof.verdict,
        "speed_rpm": proof.speed / RPM,
        "ratio": proof.ratio,
        "low": proof.low,
        "high": proof.high,
        "removed": proof.removed,
        "helps_up_to_rpm": helps and helps / RPM,
        "harms_from_rpm": harms and harms / RPM,
    }


def _read_proof(content: object, where: str) -> Proof:
    found = _checked(content, _PROOF, (), _PROOF_OPTIONAL, where)
    helps, harms = found.get("helps_up_to_rpm"), found.get("harms_from_rpm")
    same = {f.name for f in dataclasses.fields(Proof)} & found.keys()
    return Proof(
        **{name: found[name] for name in same},
        speed=found["speed_rpm"] * RPM,
        helps_up_to=helps and helps * RPM,
        harms_from=harms and harms * RPM,
    )


def _keys(values: Mapping[str, object]) -> list[str]:
    return [f"{key} = {toml_value(value)}" for key, value in values.items() if value is not None]


def _checked(
    content: object,
    kinds: Mapping[str, type],
    beside: tuple[str, ...],
    optional: tuple[str, ...],
    where: str,
) -> dict[str, Any]:
    """The keys of one table of the file: none unknown, none missing, each of its kind."""
    if not is_table(content):
        raise ModelError("is missing", where=where, limit="a table [forward], [reverse]")
    for key in content:
        if key not in kinds and key not in beside:
            raise ModelError("no such key", where=f"{where}.{key}", limit=", ".join(kinds))
    found: dict[str, Any] = {}
    for key, kind in kinds.items():
        if key not in content:
            if key in optional:
                continue
            raise ModelError("is missing", where=f"{where}.{key}", limit=kind.__name__)
        value = content[key]
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if type(value) is not kind or (kind is float and not math.isfinite(value)):
            raise ModelError(
                "is of the wrong kind", where=f"{where}.{key}", value=value, limit=kind.__name__
            )
        found[key] = value
    return found
