"""What every command that tells of a gear's worth has in common: flags, acceptance file, words."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.bench.backends.order import WORDS

if TYPE_CHECKING:
    from experiments.result import Verdict
    from rig.analysis.judging import Analysed, GearVerdict
    from rig.gears.acceptance import Acceptance

_WORDS = WORDS["acceptance"]
AcceptanceFile = Annotated[
    str, typer.Option(_WORDS.option, metavar=_WORDS.metavar, help=_WORDS.help)
]
RequireVerdict = Annotated[
    bool,
    typer.Option("--require-verdict", help="End with exit code 7 where the gear is NOT JUDGED."),
]


def acceptance_said(named: str) -> Acceptance | None:
    """The acceptance file that was named; None where none was."""
    from rig.gears.acceptance import acceptance_named

    return acceptance_named(named) if named else None


def refuse_unknown_acceptance(named: str) -> None:
    """Raise `ConfigurationError` for an acceptance file that is not there, before anything turns or is stored."""
    acceptance_said(named)


def acceptance_of(named: str, folder: Path, serial: str) -> Acceptance | None:
    """The acceptance file that was named, else that of the gear's card in this folder of runs, else none."""
    from rig.gears.acceptance import acceptance_for

    return acceptance_said(named) or acceptance_for(folder, serial)


def judged_run(one: Analysed, path: Path | None, named: str = "") -> GearVerdict:
    """The verdict on what one run measures, by the acceptance file that was named or that of its gear's card."""
    from rig.analysis.judging import judge_run

    return judge_run(one, acceptance_of(named, (path or Path()).parent, one.serial))


def verdict_text(line: Verdict) -> str:
    """One judged quantity: value, limit, whose limit it is, and what is missing."""
    from rig.analysis.judging import held_against, whose_limit

    value, limit = held_against(line)
    doubts = "".join(f"; {words}" for words in (line.because, line.rests_on) if words)
    return f"{line.name}: {value}, limit {limit} ({whose_limit(line)}){doubts}"
