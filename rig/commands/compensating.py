"""`rig compensate`: a table that takes a gear's kinematic error out of the motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from model.units import ARCSEC, RPM
from rig.commands.naming import RUNS, RunsFolder, runs_meant
from rig.commands.terminal import Json, console, echo, fact_table, painted, print_json
from rig.content.phrase import phrase, quoted

if TYPE_CHECKING:
    from model.compensation import CompensationTable, Proof
    from rig.content.grid import Grid


class FormWord(str, Enum):  # noqa: UP042  StrEnum has another str() that shows in the help
    """How a correction is written."""

    csv = "csv"
    json = "json"
    fourier = "fourier"


_Sources = Annotated[
    list[Path],
    typer.Argument(
        metavar="RUN...|TABLE",
        help="Runs of kinematic-error of one gear as it is mounted; or one of compensated-error; or a table.",
    ),
]

_Output = Annotated[
    Path | None,
    typer.Option(
        "--output", "-o", metavar="FILE", help="A new file; without it nothing is written."
    ),
]

_To = Annotated[
    FormWord | None,
    typer.Option(
        "--to", help="Not the table (TOML) but the correction of a proved one, for a drive."
    ),
]


def compensate(
    sources: _Sources,
    output: _Output = None,
    to: _To = None,
    runs_folder: RunsFolder = RUNS,
    json: Json = False,
) -> None:
    """Make a table that takes a gear's kinematic error out of the motion, and say what it will leave.

    Runs of kinematic-error give the table: the orders that the gear shows, each direction on its own, counted from the
    index marks. It is not proved: run compensated-error with it (--table FILE). That run gives the same table with its
    proof, and only a proved one is written for a drive (--to), valid up to the speed at which it was seen to help.
    """
    from model.compensation_file import compensation_text
    from rig.errors import ConfigurationError
    from rig.exchange.compensation_forms import FORMS, refuse_unproved
    from rig.runfile.sealed import write_new_sealed

    table = _table_of(runs_meant(runs_folder, sources))
    if to is not None:
        refuse_unproved(table)
        if output is None:
            raise ConfigurationError(
                "names no file",
                where="--output",
                remedy="Say where the correction goes: --output FILE.",
            )
    text = compensation_text(table) if to is None else FORMS[to.value](table)
    path = output and write_new_sealed(output, text.encode())
    if json:
        print_json({**_as_json(table), "file": path})
        return
    _show(table)
    if path is not None:
        echo(f"written  {path}")
    if table.proof is None:
        words = f"--gear {quoted(table.gear)} --table {quoted(path or 'FILE')}"
        echo(f"not proved: prove it by  rig run compensated-error {words}")


def _table_of(sources: Sequence[Path]) -> CompensationTable:
    """The table of runs, of a proof, or of its file."""
    from model.compensation_file import compensation_from
    from model.errors import ModelError
    from rig.analysis.compensation import PROOF_KIND, kinds_of, proved_table, table_from
    from rig.errors import ConfigurationError
    from rig.runfile.sealed import read_sealed

    if len(sources) == 1 and sources[0].suffix == ".toml":
        data, _ = read_sealed(sources[0])
        try:
            return compensation_from(data.decode(), str(sources[0]))
        except (ModelError, UnicodeDecodeError) as error:
            raise ConfigurationError(
                "is no table", where=str(sources[0]), value=str(error)
            ) from error
    kinds = list(kinds_of(sources))
    if kinds != [PROOF_KIND]:
        return table_from(sources)
    return proved_table(sources[0])


def _proof_as_json(proof: Proof) -> dict[str, Any]:
    helps, harms = (None if v is None else v / RPM for v in (proof.helps_up_to, proof.harms_from))
    return {
        "run": proof.run,
        "verdict": proof.verdict,
        "ratio": proof.ratio,
        "interval": [proof.low, proof.high],
        "removed": proof.removed,
        "helps_up_to_rpm": helps,
        "harms_from_rpm": harms,
    }


def _as_json(table: CompensationTable) -> dict[str, Any]:
    return {
        "gear": table.gear,
        "mounting": table.mounting,
        "ratio": table.ratio,
        "bench": table.bench,
        "runs": list(table.runs),
        "proof": table.proof and _proof_as_json(table.proof),
        "takes_out": {
            name: {"orders": list(way.labels), "rms_arcsec": table.of(sign).rms / ARCSEC}
            for name, way, sign in (
                ("forward", table.forward, 1.0),
                ("reverse", table.reverse, -1.0),
            )
        },
    }


def _show(table: CompensationTable) -> None:
    out = console()
    out.print(painted(_orders_grid(table)))
    out.print(fact_table(_facts(table), "Table"))


def _facts(table: CompensationTable) -> list[tuple[str, str]]:
    spread = math.sqrt(0.5 * sum(c[0] + c[2] for c in table.forward.covariance))
    at = " to ".join(dict.fromkeys(f"{speed / RPM:.4g}" for speed in table.speed))
    facts = [
        ("gear", f"{table.gear}, {table.mounting}, ratio {table.ratio:g}"),
        ("bench", table.bench or "not stated"),
        ("made of", f"{len(table.runs)} run(s) at {at} r/min"),
        ("takes out", f"forward {table.of(1.0).in_words()}; reverse {table.of(-1.0).in_words()}"),
        ("noise of the table", f"{spread / ARCSEC:.2g} arcsec r.m.s."),
        (
            "output encoder",
            f"may add {table.encoder_rms / ARCSEC:.2g} arcsec r.m.s., which this bench can't show"
            + phrase("; by {}", table.learnt),
        ),
    ]
    proof = table.proof
    if proof is None:
        return [*facts, ("proof", "none: not proved")]
    helps, harms = (
        None if v is None else f"{v / RPM:.4g} r/min" for v in (proof.helps_up_to, proof.harms_from)
    )
    return [
        *facts,
        (
            "proof",
            f"{proof.verdict}: leaves {proof.ratio:.2f} ({proof.low:.2f} to {proof.high:.2f}) of what was predicted",
        ),
        ("takes out, as seen", f"{100.0 * proof.removed:.0f} %"),
        ("helps up to", helps or "at none of the speeds that were run"),
        ("harms from", harms or "none of the speeds that were run"),
    ]


def _orders_grid(table: CompensationTable) -> Grid:
    """Every order of a table: amplitude each way, its noise, and what the encoder may add [arcsec]."""
    from rig.content.grid import Grid, columns, number_columns
    from rig.content.wording import number

    rows = []
    for k, label in enumerate(table.forward.labels):
        ways = (table.forward, table.reverse)
        sizes = [number(math.hypot(way.cosine[k], way.sine[k]) / ARCSEC) for way in ways]
        block = table.forward.covariance[k]
        noise = math.sqrt(0.5 * (block[0] + block[2])) / ARCSEC
        rows.append((label, *sizes, number(noise, 2), number(table.forward.encoder[k] / ARCSEC, 2)))
    heads = number_columns(
        "forward [arcsec]", "reverse [arcsec]", "noise [arcsec]", "encoder [arcsec]"
    )
    return Grid("Orders that are taken out", (*columns("order"), *heads), rows)
