"""What of a drawn figure cannot be read: words over words, words beyond the edge, a legend over what is measured."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

WIDE, HIGH = 1.0, 1.5
"""Pixels (of 100 per inch) by which two words may share a place: letters are smaller than their boxes."""
EDGE = 0.5
COVERED = 0.02
"""Share of the points of a series that may lie behind the legend."""


def unreadable(figure: Figure) -> list[str]:
    """One sentence for each fault of a figure."""
    figure.canvas.draw()
    words = list(_words(figure))
    faults = [
        f"{text.get_text()!r} goes over the edge"
        for text, box in words
        if min(box.x0, box.y0, figure.bbox.x1 - box.x1, figure.bbox.y1 - box.y1) < -EDGE
    ]
    faults += [
        f"{one.get_text()!r} lies over {other.get_text()!r}"
        for (one, a), (other, b) in combinations(words, 2)
        if min(a.x1, b.x1) - max(a.x0, b.x0) > WIDE and min(a.y1, b.y1) - max(a.y0, b.y0) > HIGH
    ]
    for axes in figure.axes:
        faults += _behind_the_legend(axes)
    return faults


def _words(figure: Figure) -> Iterator[tuple[Text, Bbox]]:
    """The texts that are drawn, but for the pale mark across; ticks beyond an axis are kept and not drawn."""
    ticks = [
        (tick.label1, low - slack <= tick.get_loc() <= high + slack)
        for axes in figure.axes
        for axis in (axes.xaxis, axes.yaxis)
        for low, high in (sorted(axis.get_view_interval()),)
        for slack in (1e-9 * (high - low),)
        for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks())
    ]
    beyond = {label for label, is_inside in ticks if not is_inside}
    for text in figure.findobj(Text):
        is_drawn = text.get_visible() and text not in beyond
        if is_drawn and text.get_text().strip() and text.get_alpha() in (None, 1.0):
            box = text.get_window_extent()
            if box.width > WIDE and box.height > WIDE:
                yield text, box


def _behind_the_legend(axes: Axes) -> Iterator[str]:
    legend = axes.get_legend()
    if legend is None:
        return
    box = legend.get_window_extent()
    for line in axes.lines:
        places = line.get_transform().transform(line.get_xydata())
        share = float(np.mean([box.contains(*place) for place in places])) if len(places) else 0.0
        if share > COVERED:
            yield f"the legend hides {100.0 * share:.0f} % of {line.get_label()!r}"
