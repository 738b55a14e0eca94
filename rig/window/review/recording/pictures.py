"""The first rows of a recording, what is proposed of its columns, and their pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from experiments.result import Plot, Series
from rig.present.decimate import peak_rows
from rig.runfile.importing.opening import kind_of, open_tables
from rig.runfile.importing.proposal import LOOKED_AT, head, propose
from rig.runfile.importing.proposed import Proposal, ProposedColumn
from rig.runfile.importing.units import TIME_CHANNEL

_MOST_DRAWN = 8
"""Columns of which a picture is drawn, the used ones first."""
LEFT_OUT = "left out"


@dataclass(frozen=True)
class Looked:
    """The files of one recording, their first rows by column, and what is proposed of them."""

    kind: str
    files: tuple[Path, ...]
    numbers: Mapping[str, NDArray[np.float64]]
    proposal: Proposal


def look_at(files: Sequence[Path]) -> Looked:
    """Read the first rows of the files of one recording. Raises `RunFileError` for what cannot be read."""
    kind = kind_of(files[0])
    tables = open_tables(kind, files)
    heads = [head(table) for table in tables]
    proposal = propose(tables, heads)
    values = [one[:, at] for one in heads for at in range(one.shape[1])]
    keys = [one.key for one in proposal.columns]
    return Looked(kind, tuple(files), dict(zip(keys, values, strict=True)), proposal)


def pictures_of(looked: Looked, proposal: Proposal) -> list[Plot]:
    """The columns over time, the used ones first; pairs of a table as points, the second over the first."""
    used = [one for one in proposal.used if one.channel != TIME_CHANNEL]
    if proposal.is_table and len(used) > 1:
        return [_picture(looked, used[0], other, "points") for other in used[1:]]
    time = next((one for one in proposal.used if one.channel == TIME_CHANNEL), None)
    drawn = [
        one
        for one in proposal.used_first
        if one is not time and np.isfinite(looked.numbers[one.key]).any()
    ]
    return [_picture(looked, time, one, "line") for one in drawn[:_MOST_DRAWN]]


def _picture(
    looked: Looked,
    across: ProposedColumn | None,
    one: ProposedColumn,
    style: Literal["line", "points"],
) -> Plot:
    y = looked.numbers[one.key]
    x = np.arange(len(y), dtype=float) if across is None else looked.numbers[across.key]
    # Files of one run may have rows of their own.
    length = min(len(x), len(y))
    rows = peak_rows(y[:length]) if style == "line" else np.arange(length)
    first = f", first {LOOKED_AT} rows" if len(y) >= LOOKED_AT else ""
    return Plot(
        name=one.key,
        title=f"{one.channel or LEFT_OUT}: {one.heading}{first}",
        x_label="row" if across is None else f"{across.channel} [{across.unit or '?'}]",
        y_label=f"[{one.unit or '?'}]",
        series=(Series(label="", x=x[rows], y=y[rows], style=style),),
    )
