"""Findings on the terminal: whatever looked, each line has its mark, what was looked at, what was found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from experiments.finding import Finding, Severity, first_blocking
from rig.commands.terminal import console
from rig.commands.visible import Text

if TYPE_CHECKING:
    from rich.table import Table

    from rig.analysis.chain import Link
    from rig.analysis.recompute import Recomputed

COLOURS = {
    Severity.PASSED: "green",
    Severity.NOT_LOOKED_AT: "dim",
    Severity.NOTES: "",
    Severity.WARNS: "yellow",
    Severity.BLOCKS: "bold red",
}


def marked(severity: Severity) -> Text:
    """The mark of a severity in its colour."""
    return Text(severity.mark, style=COLOURS[severity])


SCREEN = 16
"""Findings that are seen at a glance; of more, what failed is said once more at the end."""


def print_findings(groups: Mapping[str, Sequence[Finding]]) -> None:
    """Findings under the heading of what was looked at, then what is to be done, the gravest last."""
    out = console(highlight=True)
    everything = [finding for findings in groups.values() for finding in findings]
    widths = (
        max((len(one.severity.mark) for one in everything), default=0),
        max((len(one.what) for one in everything), default=0),
    )
    for heading, findings in groups.items():
        out.print(Text(heading, style="bold"), soft_wrap=True)
        rows = _lines(3)
        for column, width in zip(rows.columns, widths, strict=False):
            column.min_width = width
        for finding in findings:
            rows.add_row(marked(finding.severity), Text(finding.what), Text(finding.outcome))
        out.print(rows)
    for severity in (Severity.WARNS, Severity.BLOCKS):
        for heading, findings in groups.items():
            for finding in findings:
                is_far_above = severity is Severity.BLOCKS and len(everything) > SCREEN
                words = finding.remedy or (finding.outcome if is_far_above else "")
                if finding.severity is severity and words:
                    text = f"{severity.mark}  {heading}, {finding.what}: {words}"
                    out.print(text, style=COLOURS[severity], soft_wrap=True)


def _lines(columns: int) -> Table:
    """Room for findings, whose marks have the colours of their severities."""
    from rich.table import Table

    lines = Table(box=None, show_header=False)
    for _ in range(columns):
        lines.add_column(overflow="fold")
    return lines


def print_links(links: Sequence[Link], again: Sequence[Recomputed]) -> None:
    """The chain of evidence, link by link, what was made again, and which link is the first that does not hold."""
    out = console(highlight=True)
    rows = _lines(4)
    # The name of a file is what is looked for; a hash may be folded.
    rows.columns[2].no_wrap = True
    for link in (*links, *(one.finding for one in again)):
        name = link.where.replace("\\", "/").rpartition("/")[2]
        rows.add_row(marked(link.severity), link.what, Text(name), Text(link.outcome))
    out.print(rows)
    first = first_blocking(links)
    if first is not None:
        text = f"The first broken link: {first.what} {first.where}"
        out.print(Text(text, style="bold red"), soft_wrap=True)
