"""`rig fleet rr`: gauge repeatability and reproducibility over gears, benches, mountings and repeats."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.fleet_report import Origin, PartName
from rig.commands.terminal import Json, console, echo, painted, print_json
from rig.content.phrase import phrase

if TYPE_CHECKING:
    from rig.fleet.gauge.study import Studies, Study


_Results = Annotated[
    Path | None,
    typer.Argument(
        metavar="[DATASET|CSV]",
        help="Folder of results, or of the runs with them; or a table with the columns gear, bench, value.",
    ),
]

_Quantity = Annotated[
    list[str] | None,
    typer.Option(metavar="KIND.NAME", help="Only this quantity; key and limited ones without it."),
]

_Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FILE", help="Write a page: .html or .pdf."),
]

_Plan = Annotated[
    bool,
    typer.Option("--plan", help="Propose a study instead; by the one that is named, if any."),
]

_Within = Annotated[
    float,
    typer.Option(
        min=1.0, max=50.0, metavar="POINTS", help="Wished half-width of %GRR, with --plan."
    ),
]

_Benches = Annotated[
    int, typer.Option(min=2, max=20, help="How many benches there are at most, with --plan.")
]

_Percent = Annotated[
    float,
    typer.Option(
        min=1.0, max=99.0, metavar="%", help="%GRR to be expected, with --plan and no study."
    ),
]


def rr(
    results: _Results = None,
    quantity: _Quantity = None,
    output: _Output = None,
    origin: Origin = "",
    part: PartName = "",
    plan: _Plan = False,
    within: _Within = 10.0,
    benches: _Benches = 4,
    percent: _Percent = 30.0,
    json: Json = False,
) -> None:
    """Say how well benches, mountings and repeats tell gears apart: %GRR, ndc, and what each part adds.

    Every gear goes to every bench, is mounted anew there and measured several times; `rig fleet fit` gathers the runs.
    A balanced study goes by analysis of variance, one with gaps by restricted maximum likelihood, which is said. Every
    number has its 95 % interval: with few benches it is wide, and --plan says what would make it narrower.
    """
    from rig.fleet.gauge.study import studies_of, study_of_table

    if plan:
        _propose(results, within, benches, percent, quantity or [], json)
        return
    if results is not None and results.suffix.lower() == ".csv":
        found = study_of_table(results)
    else:
        from rig.extras import require
        from rig.fleet.questions import results_folder

        require("a study of the gauge", "fleet", "pyarrow", "duckdb")
        folder = results_folder(results)
        found = studies_of(folder, origin=origin, part=part, wanted=quantity or ())
    written = _written(found, output)
    if json:
        _print_json(found, written)
    else:
        _print(found, written)


def _written(found: Studies, output: Path | None) -> Path | None:
    if output is None:
        return None
    from datetime import datetime

    from rig.fleet.gauge.page import write_gauge_page

    now = datetime.now().astimezone().isoformat(timespec="seconds")
    return write_gauge_page(found, output, now)


def _print_json(found: Studies, written: Path | None) -> None:
    from rig.fleet.gauge.page import study_as_json

    print_json(
        {
            "source": str(found.source),
            "origin": found.origin,
            "studies": [study_as_json(one) for one in found.studies],
            "not_studied": [{"quantity": name, "reason": why} for name, why in found.lacking],
            "report": written,
        }
    )


def _print(found: Studies, written: Path | None) -> None:
    from rig.fleet.gauge.page import components_grid, summary
    from rig.fleet.gauge.study import words_of
    from rig.runfile.header import ORIGIN_WORDS

    out = console()
    out.print(painted(summary(found.studies)))
    if len(found.studies) == 1:
        out.print(painted(components_grid(found.studies[0])))
    shapes = {one.shape for one in found.studies}
    mark = phrase("{}  ", ORIGIN_WORDS.get(found.origin, found.origin.upper()))
    echo(f"{mark}{'; '.join(sorted(shapes))}")
    for one in _named(found.studies):
        echo(f"{one.title}: {' '.join(words_of(one))}")
    for name, why in found.lacking:
        echo(f"not studied: {name}: {why}")
    if written is not None:
        echo(f"report in {written}")


def _named(studies: tuple[Study, ...]) -> tuple[Study, ...]:
    """The studies whose sentences a screen has room for: the worst gauge of several."""
    return tuple(sorted(studies, key=lambda one: -one.gauge.percent_of_study)[:1])


def _propose(
    results: Path | None,
    within: float,
    benches: int,
    percent: float,
    wanted: list[str],
    json: bool,
) -> None:
    from dataclasses import asdict

    from rig.fleet.gauge.page import designs_grid
    from rig.fleet.gauge.plan import designs, narrowest, proposals, variances_of

    variances = variances_of(percent) if results is None else _variances(results, wanted)
    every = designs(variances, benches)
    proposed = proposals(every, within)
    title = f"Studies that tell %GRR within ± {within:g} points, the fewest runs first"
    if not proposed:
        proposed = [narrowest(every)]
        title = (
            f"No study with {benches} benches tells %GRR within ± {within:g} points; the narrowest"
        )
    if json:
        rows = [{**asdict(one), "runs": one.runs} for one in proposed]
        kept = proposed[0].half_width <= within
        print_json({"within": within, "is_kept": kept, "assumed": results is None, "designs": rows})
    else:
        console().print(painted(designs_grid(proposed, title, is_assumed=results is None)))


def _variances(results: Path, wanted: list[str]) -> dict[str, float]:
    """The variances of the one study that is named."""
    from rig.fleet.gauge.study import studies_of, study_of_table
    from rig.fleet.questions import results_folder

    if results.suffix.lower() == ".csv":
        found = study_of_table(results)
    else:
        found = studies_of(results_folder(results), wanted=wanted)
    worst = max(found.studies, key=lambda one: one.gauge.percent_of_study)
    return dict(worst.gauge.variances)
