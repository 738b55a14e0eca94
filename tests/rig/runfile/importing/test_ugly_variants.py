"""Ugly variants of one recording: each gives the numbers of the plain one, to the digits that the variant holds."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from experiments.result import Result
from rig.analysis.fit.run import fit_run
from rig.runfile.importing.channel_map import ImportOptions
from tests.rig.runfile.importing.ugly import (
    ANGLE,
    COULOMB,
    INERTIA,
    OFFSET,
    SPEED,
    TIME,
    TORQUE,
    VISCOUS,
    motion_of,
    run_of,
)

DEGREES, POUND_INCH = np.rad2deg(ANGLE), TORQUE / 0.1129848290276167
MILLISECONDS, MILLI_TORQUE = 1e3 * TIME, 1e3 * TORQUE
ROWS = np.column_stack([TIME, ANGLE, TORQUE]).tolist()
COUNTS = 2**20
"""Per turn; an angle in counts holds six digits of a radian."""
COUNTED = np.round(ANGLE * COUNTS / (2.0 * np.pi))
Write = Callable[[Path], None]


def text(*lines: str, columns: tuple[np.ndarray, ...] = (TIME, ANGLE, TORQUE), **how: Any) -> Write:
    """A file of these lines, then of the columns; `decimal`, `between` and `end` as somebody's program writes them."""

    def write(path: Path) -> None:
        between, decimal = how.get("between", ","), how.get("decimal", ".")
        rows = (between.join(f"{x:.10g}" for x in row) for row in np.column_stack(columns))
        body = [*lines, *(row.replace(".", decimal) for row in rows), *how.get("end", ())]
        path.write_text("\n".join(body) + "\n", encoding="utf-8")

    return write


def as_json(content: object) -> Write:
    def write(path: Path) -> None:
        path.write_text(json.dumps(content), encoding="utf-8")

    return write


def as_mat(path: Path) -> None:
    scipy.io.savemat(path, {"t": TIME, "q": ANGLE, "tau": TORQUE})


@dataclass(frozen=True)
class Variant:
    """How it is written, file by file; what is answered, said beside it and stated; how near its numbers come."""

    files: Mapping[str, Write]
    answers: Mapping[str, str] = field(default_factory=dict)
    beside: tuple[str, ...] = ()
    stated: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    options: ImportOptions = field(default_factory=lambda: ImportOptions(channels=()))
    within: float = 1e-6


NAMES = ("time [s]", "pos [rad]", "tau [N m]")
SCOPE = (
    "Name\tjoint",
    "File\tjoint.csv",
    "Starttime of export\t132959733843760000\tMontag\t15:56",
    "Endtime of export\t132959733943760000\tMontag\t15:56",
    "",
    "",
    "Name\tpos\ttau",
    "SampleTime[ms]\t4\t4",
    "ScaleFactor\t1\t1",
    "Unit\trad (Angle)\tNm (Torque)",
    "",
)
VARIANTS = {
    "units": Variant(
        {
            "a.csv": text(
                "t [ms],angle [deg],torque [mN m]", columns=(MILLISECONDS, DEGREES, MILLI_TORQUE)
            )
        }
    ),
    "imperial": Variant(
        {
            "a.csv": text(
                "Time (s),Position (deg),Torque (lbf in)", columns=(TIME, DEGREES, POUND_INCH)
            )
        }
    ),
    "semicolons, decimal comma": Variant(
        {"a.csv": text(";".join(NAMES), between=";", decimal=",")}
    ),
    "tabs": Variant({"a.txt": text("\t".join(NAMES), between="\t")}),
    "units in a second line": Variant(
        {"a.csv": text("Time;Position;Torque", "s;rad;Nm", between=";")}
    ),
    "lines before, a word at the end": Variant(
        {"a.csv": text("Logger 3.1", "Operator: nobody", "", ",".join(NAMES), end=("EOF",))},
        options=ImportOptions(channels=(), drop_bad_rows=True),
    ),
    "no headings": Variant(
        {"a.csv": text()},
        beside=("position=2:rad", "torque=3:N m"),
    ),
    "two files": Variant(
        {
            "pos.csv": text("time [s],pos [rad]", columns=(TIME, ANGLE)),
            "torque.csv": text("time [s],tau [N m]", columns=(TIME, TORQUE)),
        }
    ),
    "two files, each in its own form": Variant(
        {
            "pos.csv": text("by somebody", "time,pos [rad]", columns=(TIME, ANGLE)),
            "torque.csv": text(
                "time;tau [N m]", columns=(MILLISECONDS, TORQUE), between=";", decimal=","
            ),
        },
        options=ImportOptions(
            channels=(),
            files={"pos": {"skip": 1, "time_unit": "s"}, "torque": {"time_unit": "ms"}},
        ),
    ),
    "JSON, rows": Variant(
        {"a.json": as_json([dict(zip(NAMES, row, strict=True)) for row in ROWS])}
    ),
    "JSON, columns": Variant(
        {
            "a.json": as_json(
                dict(zip(NAMES, (c.tolist() for c in (TIME, ANGLE, TORQUE)), strict=True))
            )
        }
    ),
    "JSON, split": Variant({"a.json": as_json({"columns": list(NAMES), "data": ROWS})}),
    "MATLAB": Variant({"a.mat": as_mat}, {"of q": "rad", "of tau": "N m"}),
    "a scope's block": Variant(
        {"a.csv": text(*SCOPE, columns=(MILLISECONDS, ANGLE, TORQUE), between="\t", end=("EOF",))}
    ),
    "wrapped": Variant(
        {
            "a.csv": text(
                "time [s],angle [deg],tau [N m]", columns=(TIME, np.mod(DEGREES, 360.0), TORQUE)
            )
        },
        stated={"modulus": {"position": "360"}},
    ),
    "counts": Variant(
        {"a.csv": text("time [s],position [counts],tau [N m]", columns=(TIME, COUNTED, TORQUE))},
        {"count": str(COUNTS)},
        within=2e-3,
    ),
}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Result:
    folder = tmp_path_factory.mktemp("plain")
    text(",".join(NAMES))(folder / "joint.csv")
    return motion_of(run_of([folder / "joint.csv"], folder))


def test_the_plain_one_finds_the_truth(plain: Result) -> None:
    for name, truth in (("inertia", INERTIA), ("viscous", VISCOUS), ("coulomb", COULOMB)):
        found = plain.estimates[name]
        assert abs(found.value - truth) < found.expanded_uncertainty
        assert found.value == pytest.approx(truth, rel=0.02)
    assert plain.estimates["offset"].value == pytest.approx(OFFSET, rel=0.02)


@pytest.mark.parametrize("name", VARIANTS)
def test_an_ugly_variant_gives_the_same_numbers(name: str, plain: Result, tmp_path: Path) -> None:
    variant = VARIANTS[name]
    for file, write in variant.files.items():
        write(tmp_path / file)
    files = [tmp_path / file for file in variant.files]
    run = run_of(
        files,
        tmp_path / "runs",
        variant.answers,
        beside=variant.beside,
        stated=variant.stated,
        options=variant.options,
    )
    found = motion_of(run)
    for key in ("inertia", "viscous", "coulomb", "offset"):
        expected = plain.estimates[key].value
        assert found.estimates[key].value == pytest.approx(expected, rel=variant.within), key


def test_a_part_of_it_in_one_direction_holds_the_whole(plain: Result, tmp_path: Path) -> None:
    forward = SPEED > 0.0
    text(",".join(NAMES), columns=tuple(c[forward] for c in (TIME, ANGLE, TORQUE)))(
        tmp_path / "a.csv"
    )
    found = motion_of(run_of([tmp_path / "a.csv"], tmp_path / "runs"))
    assert "offset" not in found.estimates
    for key in ("inertia", "viscous", "coulomb"):
        one = found.estimates[key]
        assert abs(one.value - plain.estimates[key].value) < one.expanded_uncertainty, key


def test_a_part_of_it_at_constant_speed_holds_the_orders_of_the_whole(tmp_path: Path) -> None:
    """The whole has an angle; a part of its torque alone, with the speed that was set, bears the same order."""
    time = np.arange(12_000) * 1e-3
    angle = 10.0 * time
    noise = 1e-3 * np.random.default_rng(4712).standard_normal(len(time))
    torque = 0.3 + 0.02 * np.cos(3.0 * angle + 0.4) + noise
    text(",".join(NAMES), columns=(time, angle, torque))(tmp_path / "whole.csv")
    text("time [s],tau [N m]", columns=(time[:7000], torque[:7000]))(tmp_path / "part.csv")
    whole = fit_run(run_of([tmp_path / "whole.csv"], tmp_path / "whole"), "order-spectrum").result
    said = ImportOptions(channels=(), speed="10 rad/s")
    part = run_of([tmp_path / "part.csv"], tmp_path / "part", options=said)
    found = fit_run(part, "order-spectrum").result.estimates["amplitude_3"]
    assert abs(found.value - whole.estimates["amplitude_3"].value) < found.expanded_uncertainty
    assert found.identifiable == "weakly"
