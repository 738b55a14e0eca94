"""A gear made by hand for the certificate's tests: two runs with analyses, a laboratory, and its two pages."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pypdf

from experiments import catalogue
from experiments.result import Panel, Plot, Result, Series
from model.gear_file import gear_to_mapping, shipped_gear
from rig.analysis.result_data import quantities_for
from rig.analysis.store import Basis, append_analysis
from rig.gears.acceptance import Acceptance, Limit
from rig.present.certificate.gather import Certified, certified
from rig.present.certificate.laboratory import LaboratoryWords
from rig.present.certificate.rests_on import manifest_of
from rig.present.certificate.sheets import Paper, Sheets, sheets_of, typeset
from rig.runfile.seal import recorded_sha256
from tests.rig.handmade import save_acceptance
from tests.rig.library.stored import RUNNING, estimate, start, write

AT = "2026-03-02T10:00:00+00:00"
ACCURACY = "transmission_accuracy_forward"
LABORATORY = LaboratoryWords(
    name="Test house", address="Street 1", customer="Robots Ltd", order="PO 4711", method="TI 12"
)
X = np.linspace(1.0, 3000.0, 40)
SPEEDS = np.geomspace(1.0, 3000.0, 20)
FORWARD, REVERSE = 50.0 + SPEEDS / 50.0, 52.0 + SPEEDS / 50.0
CURVES = {
    "friction": (
        Plot(
            name="friction-curve",
            title="No-load running torque over speed",
            x_label="input speed [r/min]",
            y_label="torque [mN m]",
            series=(Series(label="measured", x=X, y=50.0 + X / 50.0, style="points"),),
            figure="9",
        ),
        Plot(
            name="friction-directions",
            title="Friction torque, measured and fitted",
            x_label="input speed [r/min]",
            y_label="torque [mN m]",
            series=(
                Series(label="measured, forward", x=SPEEDS, y=FORWARD, style="points"),
                Series(label="measured, reverse", x=-SPEEDS, y=-REVERSE, style="points"),
                Series(label="fitted, forward", x=SPEEDS, y=FORWARD + 9.0),
            ),
            figure="17",
        ),
    ),
    "kinematic-error": (
        Plot(
            name="transmission-accuracy",
            title="Fitted error over one output revolution",
            x_label="output angle [deg]",
            y_label="forward [arcmin]",
            series=tuple(
                Series(label=way, x=X * 0.12, y=np.sin(X), panel=panel)
                for panel, way in enumerate(("forward", "reverse"))
            ),
            panels=(Panel("reverse [arcmin]", 1.0),),
        ),
    ),
}


def limit_of(kind: str, name: str, upper: float, unit: str) -> Limit:
    return Limit(
        quantity=f"{kind}.{name}",
        unit=unit,
        source="specification, page 12",
        standing="customer",
        upper=upper,
        confirmed_by="A. Example",
        confirmed_on="2026-01-02",
    )


ACCEPTANCE = Acceptance(
    name="specification",
    source="page 12",
    use="any",
    limits=(
        limit_of("friction", RUNNING, 0.09, "mN m"),
        limit_of("kinematic-error", ACCURACY, 4e-4, "arcmin"),
    ),
    path="spec.toml",
)


def lay(folder: Path, number: int, kind: str, found: dict[str, Any], **more: Any) -> Path:
    """A run with its analysis in the store."""
    run = write(folder, number, kind, start_time=start(number), operator="Ada Grün", **more)
    result = Result(
        run=run.name.removesuffix(".h5"),
        kind=kind,
        quantities=quantities_for(kind, found, ()),
        estimates=found,
        plots=CURVES[kind],
        options={"torque_is_of": "gear"},
    )
    basis = Basis(
        recorded_sha256(run),
        AT,
        gear_to_mapping(shipped_gear()),
        analysis_version=catalogue.load(kind).version,
    )
    append_analysis(run, result, basis)
    return run


def gear(folder: Path, torque: float = 0.08, accuracy: float = 3e-4, **more: Any) -> Path:
    """The two runs of a gear."""
    lay(folder, 1, "friction", {RUNNING: estimate(RUNNING, torque, own=2e-4)}, **more)
    found = {ACCURACY: estimate(ACCURACY, accuracy, "rad", own=1e-5)}
    lay(folder, 2, "kinematic-error", found, **more)
    save_acceptance(ACCEPTANCE, folder / "spec.toml")
    return folder


def accepted(folder: Path) -> Acceptance:
    return replace(ACCEPTANCE, path=str(folder / "spec.toml"))


def sheets_made(gathered: Certified, laboratory: LaboratoryWords = LABORATORY) -> Sheets:
    """The two pages of what was gathered."""
    told = {"number": "HC-1", "created": AT, "manifest_file": "c.manifest.txt"}
    return sheets_of(gathered, laboratory, manifest_of(gathered), **told)


def sheets_in(folder: Path, laboratory: LaboratoryWords = LABORATORY, **more: Any) -> Sheets:
    with certified(folder, "A1", **{"acceptance": accepted(folder), **more}) as gathered:
        return sheets_made(gathered, laboratory)


def printed(sheets: Sheets, paper: Paper = "a4") -> list[str]:
    """The text of every page of the PDF."""
    (document,) = typeset(sheets, paper, format="pdf")
    return [page.extract_text() for page in pypdf.PdfReader(io.BytesIO(document)).pages]


def words_in(text: str) -> int:
    """Words: what stands between blanks and has a letter in it, units and letters of an axis among them."""
    return sum(any(c.isalpha() for c in word) for word in text.split())
