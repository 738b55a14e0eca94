"""The chart of the golden gear: its runs beside the first five, one figure for each quantity."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from experiments.result import Plot, Series
from rig.analysis.golden import FIRST, CheckedQuantity, Golden
from rig.content.grid import Grid, capital, columns
from rig.content.page import Page, Section, Signature, State
from rig.content.phrase import phrase
from rig.content.wording import number
from rig.present.page import write_page
from rig.present.report import drawn, marks_of, page_facts, program_version, shown


def checked_grid(golden: Golden) -> Grid:
    """One line for each quantity: what the newest run says."""
    rows = [
        (
            one.title,
            str(len(one.runs)),
            number(one.newest.difference / one.factor, 3),
            _uncertainty(one),
            one.shown_unit,
            one.state,
        )
        for one in golden.quantities
    ]
    heads = columns(
        ("quantity", "quantity"),
        ("runs", "number"),
        ("from the first", "number"),
        ("U", "number"),
        "unit",
        "state",
    )
    note = f"From the mean of the first {FIRST} runs; U (99 %) without what all runs share."
    return Grid(f"Golden gear {golden.serial}", heads, rows, note)


def _uncertainty(one: CheckedQuantity) -> str:
    u = one.newest.uncertainty_where_judged
    return "–" if u is None else number(u / one.factor, 2)


def difference_plot(one: CheckedQuantity) -> Plot:
    """The difference of every run to the first ones, with U where it is judged."""
    x = np.arange(1.0, len(one.runs) + 1.0)
    y = np.array([run.difference for run in one.runs]) / one.factor
    u = np.array([run.expanded_uncertainty for run in one.runs]) / one.factor
    first, later = x <= FIRST, x > FIRST
    series = [Series(label=f"first {FIRST}", x=x[first], y=y[first], style="points")]
    if later.any():
        low, high = (y - u)[later], (y + u)[later]
        series.append(
            Series(
                label="later", x=x[later], y=y[later], style="points", low=low, high=high, group=1
            )
        )
    ends = np.array([0.5, len(one.runs) + 0.5])
    series.append(Series(label="", x=ends, y=np.zeros(2), role="null"))
    unit = phrase(" [{}]", one.shown_unit)
    return Plot(
        name="golden",
        title=one.title,
        x_label="run, in order of time",
        y_label=f"from the first {FIRST}{unit}",
        series=tuple(series),
        note=f"run 1 is of {one.runs[0].start[:10]}, run {len(one.runs)} of {one.newest.start[:10]}",
    )


def _golden_page(golden: Golden, created: str) -> Page:
    """The page of the check; `created` is its calendar time (ISO 8601)."""
    state = "CHANGED" if golden.is_changed else "NO CHANGE SEEN"
    return Page(
        kind="Check of a bench",
        number=f"HG-{golden.newest}",
        heading=f"Golden gear {golden.serial}",
        created=created,
        version=program_version(),
        subtitle="What changes with a gear that is kept to be measured again is the bench",
        facts=page_facts([golden.origin], golden.serial, [], golden.newest),
        marks=marks_of([golden.origin]),
        states=(
            State(state, "; ".join(f"{one.title}: {one.sentence}" for one in golden.quantities)),
        ),
        judged=shown(checked_grid(golden)),
        sections=tuple(_sections(golden)),
        signature=Signature(False, "A check of the bench is signed by whom it was ordered."),
        run_line=f"golden gear {golden.serial}",
    )


def _sections(golden: Golden) -> Iterator[Section]:
    for place, one in enumerate(golden.quantities, 1):
        rows = [
            (
                run.run,
                run.start[:10],
                number(run.difference / one.factor, 3),
                "; ".join(run.changes),
            )
            for run in one.runs
        ]
        heads = columns(
            "run", "date", ("from the first", "number"), ("changed beside it", "sentence")
        )
        yield Section(
            title=capital(one.title),
            anchor=f"part-{place}",
            text=one.sentence,
            figures=(drawn(difference_plot(one), golden.origin, place),),
            grids=shown(Grid("Runs", heads, rows)),
        )


def write_golden_page(golden: Golden, path: Path, created: str) -> Path:
    """Write it as HTML or, by its suffix, as PDF. Raises `RigError` where it cannot be written."""
    return write_page(_golden_page(golden, created), path)
