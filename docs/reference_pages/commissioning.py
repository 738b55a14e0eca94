"""The page of the stages in which a bench is commissioned."""

from __future__ import annotations

from collections.abc import Iterable

from reference_pages.words import cell


def commissioning() -> Iterable[str]:
    """Every stage: how the gear is, what is done, what must be seen."""
    from model.units import RPM
    from rig.bench.commissioning import COUPLED, FIRST_SPEED, FIRST_TURNS, STAGES

    later = [stage.name for stage in STAGES if stage.name in COUPLED]
    yield "# Stages of a commissioning"
    yield ""
    yield (
        f"`rig commission`, in this order. Until those with the gear uncoupled are done nothing turns faster than "
        f"{FIRST_SPEED / RPM:.0f} r/min; until {' and '.join(later)} are done the "
        f"output turns no further than {FIRST_TURNS:.0f} time. How it is done: [](../../howto/commission-a-bench.md)."
    )
    yield "\n| stage | gear | what is done | what must be seen |\n|---|---|---|---|"
    for stage in STAGES:
        yield f"| `{stage.name}` | {stage.gear} | {cell(stage.does)} | {cell(stage.must_be_seen)} |"
