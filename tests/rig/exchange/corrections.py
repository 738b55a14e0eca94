"""Reads a correction as whoever takes it for a drive would: from its text alone."""

from __future__ import annotations

import json

import numpy as np

from model.arrays import FloatArray
from model.units import ARCSEC, DEGREE, REVOLUTION
from rig.exchange.compensation_forms import WAYS, CorrectionForm

_PER_WAVE = 24
"""Points of the fastest wave between which a reader draws straight lines."""


def at(form: CorrectionForm, angle: FloatArray, way: str) -> FloatArray:
    """c at output angles [rad], linear between the points, whole turns apart alike."""
    return np.interp(angle, form.angle, form.correction[way], period=REVOLUTION)


def read_csv(text: str) -> CorrectionForm:
    """What `csv_text` wrote."""
    rows = [line for line in text.splitlines() if not line.startswith("#")]
    columns = np.array([line.split(",") for line in rows[1:]], dtype=np.float64).T
    named = dict(zip(rows[0].split(","), columns, strict=True))
    curves = {way: named[f"{way}_arcsec"] * ARCSEC for way in WAYS}
    return CorrectionForm(_comments(text), named["output_angle_deg"] * DEGREE, curves)


def read_json(text: str) -> CorrectionForm:
    """What `json_text` wrote."""
    found = json.loads(text)
    angle = np.array(found.pop("output_angle_deg")) * DEGREE
    curves = {way: np.array(found.pop(f"{way}_arcsec")) * ARCSEC for way in WAYS}
    return CorrectionForm(found, angle, curves)


def read_fourier(text: str) -> CorrectionForm:
    """What `fourier_text` wrote, at as many angles as its fastest wave asks for."""
    rows = [line.split(",") for line in text.splitlines() if line.startswith(WAYS)]
    fastest = max((int(row[1]) for row in rows), default=1)
    angle = np.linspace(0.0, REVOLUTION, _PER_WAVE * max(fastest, 1), endpoint=False)
    curves = {way: np.zeros_like(angle) for way in WAYS}
    for way, cycles, cosine, sine in rows:
        wave = float(cosine) * np.cos(int(cycles) * angle) + float(sine) * np.sin(
            int(cycles) * angle
        )
        curves[way] += wave * ARCSEC
    return CorrectionForm(_comments(text), angle, curves)


def _comments(text: str) -> dict[str, str]:
    pairs = (line[2:].partition(": ") for line in text.splitlines() if line.startswith("# "))
    return {name: value for name, _, value in pairs}
