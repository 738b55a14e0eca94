"""The page of what is assumed where nobody says it, from the table of the experiments."""

from __future__ import annotations

from collections.abc import Iterable

from reference_pages.words import cell


def assumed() -> Iterable[str]:
    """Every row of the table: what is assumed, how large, why, and what replaces it."""
    from experiments.assumed import LARGEST_SHARE, TABLE

    yield "# What we assume when you don't tell us"
    yield ""
    yield (
        "A value that nobody gives is not zero. Where an import, `rig.toml` or a gear card leaves one away, "
        "the line of its kind from this table stands in the budgets, marked as assumed. Whoever states 0 is believed."
    )
    yield ""
    yield (
        f"A number that rests on assumed lines for more than {100.0 * LARGEST_SHARE:g} % of its U² is at best "
        '"weakly", and what is judged by it says "rests on an assumed ...". Orders of the output\'s turn are '
        'never "yes" without a stated output encoder. `rig import`, `rig doctor` and the certificate name each '
        "kind that is assumed, in one line."
    )
    for row in TABLE:
        yield f"\n## {row.kind}\n"
        yield "| | |\n|---|---|"
        for name, text in (
            ("what", row.what),
            ("assumed", row.bounds),
            ("standard uncertainty", f"{row.standard_uncertainty:.3g} {row.unit}"),
            ("distribution", row.distribution),
            ("source", row.source),
            ("reason", row.reason),
            ("what replaces it", row.replaced_by),
        ):
            yield f"| {name} | {cell(text)} |"
    yield "\n## Files of earlier versions\n"
    yield (
        "Run files before format 1.2 (versions 0.1.0 and 0.2.0) hold 0 for an uncertainty that nobody stated and "
        "for one that was stated as 0, and nothing tells the two apart: 0 is read as not said. Only instruments of "
        "a simulated rig are known to have said it, and stay at 0. Everything else in such files is read as it "
        "stands. An analysis that was stored keeps its numbers; made anew it has the assumed lines."
    )
