"""The same figure of several runs over each other: a colour per run, a dash per curve of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from experiments.result import Plot
from rig.content.phrase import phrase


@dataclass(frozen=True)
class Overlaid:
    """One run of an overlay: its name in the legend, the mark of its origin, its figures, and its
    place, which is its colour.
    """

    name: str
    mark: str
    plots: tuple[Plot, ...]
    place: int


@dataclass(frozen=True)
class Overlay:
    """One figure of several runs, the runs that are in it, and sentences on those that are not."""

    plot: Plot
    runs: tuple[str, ...]
    left_out: tuple[str, ...] = ()


def common_figures(runs: Sequence[Overlaid]) -> dict[str, str]:
    """Figures that at least two of the runs have: their name and title, in the order of the first run that has them."""
    titles: dict[str, str] = {}
    count: dict[str, int] = {}
    for run in runs:
        for plot in run.plots:
            titles.setdefault(plot.name, plot.title)
            count[plot.name] = count.get(plot.name, 0) + 1
    return {name: title for name, title in titles.items() if count[name] > 1}


def overlay(runs: Sequence[Overlaid], name: str) -> Overlay | None:
    """The figure of this name of every run that has it over the axes that most have; None where no run has it.

    The runs are aligned by what the figure is drawn over: angle, speed, time or order.
    """
    pairs = [(run, plot) for run in runs for plot in run.plots if plot.name == name]
    if not pairs:
        return None
    every = [axes_of(plot) for _, plot in pairs]
    axes = max(every, key=every.count)
    first = pairs[every.index(axes)][1]
    having = [run for run, _ in pairs]
    left_out = [f"{run.name} has no such figure." for run in runs if run not in having]
    series, names = [], []
    for run, plot in pairs:
        odd = [mine for mine, theirs in zip(axes_of(plot), axes, strict=True) if mine != theirs]
        if odd:
            left_out.append(f"{run.name} is drawn over other axes ({', '.join(odd)}).")
            continue
        names.append(run.name)
        series += [
            replace(s, label=run.name + phrase(": {}", s.label), group=run.place)
            for s in plot.series
        ]
    plot = replace(first, series=tuple(series), note="")
    return Overlay(plot, tuple(names), tuple(left_out))


def axes_of(plot: Plot) -> tuple[str, ...]:
    """What must be the same for two figures to be drawn over each other."""
    panels = ", ".join(panel.y_label for panel in plot.panels)
    return plot.x_label, plot.y_label, plot.x_scale, plot.y_scale, panels


def short_names(runs: Mapping[str, tuple[int, str]]) -> dict[str, str]:
    """Names for a legend by run: its number and gear; the whole name where that would not tell two apart."""
    names = {
        run: " ".join(part for part in (f"{number:05d}" if number else "", serial) if part)
        for run, (number, serial) in runs.items()
    }
    every = list(names.values())
    twice = {name for name in every if every.count(name) > 1 or not name}
    return {run: run if name in twice else name for run, name in names.items()}


def mark_of(runs: Sequence[Overlaid]) -> str:
    """The marks of all runs; hardware among them is said."""
    marks = list(dict.fromkeys(run.mark or "HARDWARE" for run in runs))
    return "" if marks == ["HARDWARE"] else " + ".join(marks)
