"""`rig certificate`: what the customer gets of a gear."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from rig.commands.judgement import AcceptanceFile, RequireVerdict, acceptance_said
from rig.commands.reporting import ReportFormat, suffixes_of
from rig.commands.sealing import Unsealed
from rig.commands.terminal import Json, console, echo, print_json


class _PaperSize(str, Enum):  # noqa: UP042  StrEnum has another str() that shows in the help
    """What the two pages are printed on."""

    a4 = "a4"
    letter = "letter"


_Gear = Annotated[str, typer.Option("--gear", metavar="SERIAL", help="Serial number of the gear.")]

_Output = Annotated[
    Path, typer.Option("--output", "-o", metavar="FILE", help="What to write: .pdf or .html.")
]

_Format = Annotated[
    ReportFormat | None,
    typer.Option(
        "--format", help="Instead of the suffix of FILE; both writes the two side by side."
    ),
]

_Config = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE",
        help="Description of the rig whose [laboratory] stands on the page; rig.toml, where there is one.",
    ),
]

_Paper = Annotated[_PaperSize, typer.Option("--paper", help="Size of the two pages.")]


def certificate(
    gear: _Gear,
    output: _Output = Path("certificate.pdf"),
    format_: _Format = None,
    folder: Annotated[Path, typer.Option("--runs", metavar="DIR", help="Folder of runs.")] = Path(
        "runs"
    ),
    acceptance: AcceptanceFile = "",
    config: _Config = None,
    paper: _Paper = _PaperSize.a4,
    require_verdict: RequireVerdict = False,
    unsealed: Unsealed = False,
    json: Json = False,
) -> None:
    """Write the certificate of a gear: exactly two pages; all else is the report.

    It reads the analyses in force of the newest run of every kind and fits nothing. It is a CERTIFICATE where every
    instrument that enters a verdict had a certificate that was not overdue on the day of the test, else a TEST REPORT
    that says which had not, or a SIMULATION. INCOMPLETE stands on it where a protocol that the acceptance file asks
    for has no analysed run. The exit code is the verdict: 0 PASS or NOT JUDGED, 1 FAIL, 3 MARGINAL. Only runs from
    hardware have room for a signature; all others are marked on both pages.
    """
    from rig.bench.config.place import DEFAULT_PATH
    from rig.commands.result_tables import print_verdict
    from rig.exits import code_of_verdict
    from rig.present.certificate.laboratory import laboratory_of
    from rig.present.certificate.write import write_certificate

    described = config or (DEFAULT_PATH if DEFAULT_PATH.is_file() else None)
    written = write_certificate(
        folder,
        gear,
        [output.with_suffix(suffix) for suffix in suffixes_of(output, format_)],
        acceptance=acceptance_said(acceptance),
        laboratory=laboratory_of(described),
        paper=paper.value,
    )
    if json:
        print_json(written.as_json())
    else:
        for path in written.paths:
            echo(f"{path}: {written.title.lower()} {written.number}, two pages")
        if written.untraceable:
            echo(written.untraceable)
        if written.missing:
            echo(f"INCOMPLETE: no analysed run of {', '.join(written.missing)}")
        print_verdict(console(), written.verdict)
    raise typer.Exit(code_of_verdict(written.verdict.verdict, required=require_verdict))
