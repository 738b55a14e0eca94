"""How `rig run` ends: the sealed run is digested, and what it says of the gear is told in a few lines."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import catalogue
from rig.commands.judgement import acceptance_of
from rig.commands.terminal import toned
from rig.commands.visible import Text
from rig.content.phrase import quoted

if TYPE_CHECKING:
    from rich.console import Console

    from rig.analysis.fit.digest import Digest
    from rig.analysis.judging import GearVerdict
    from rig.bench.backends.order import Order
    from rig.run.parts import RunReport

MOST_LINES = 5
"""Values that are told without --all."""


@dataclass(frozen=True)
class Ending:
    """The verdict on a run with what its analysis says; `crash` is why a completed run has none that it should have,
    `refusal` why its recording does not bear the analysis: the command ends as `rig fit` of it would.
    """

    verdict: GearVerdict
    digest: Digest | None = None
    crash: str = ""
    refusal: str = ""

    def as_json(self) -> dict[str, Any]:
        """The keys that `rig run --json` adds to those of the run."""
        told = {} if self.digest is None else self.digest.as_json()
        return {
            **self.verdict.as_json(),
            **told,
            "analysis_error": self.crash,
            "analysis_refused": self.refusal,
        }


def ending_of(report: RunReport, order: Order) -> Ending:
    """What a run says of its gear. One that was not brought to its end says nothing, and is not analysed.

    Whatever goes wrong with the analysis costs neither the run nor its outcome: it is told.
    """
    from rig.analysis.fit.digest import digest
    from rig.analysis.judging import judge_run, not_judged

    if report.outcome != "COMPLETED":
        return Ending(not_judged(f"the run ended as {report.outcome}"))
    if not report.readable or order.protocol not in catalogue.kinds():
        return Ending(not_judged("the run cannot be analysed"))
    now = datetime.now().astimezone().isoformat(timespec="seconds")
    try:
        made = digest(report.path, now)
        if made.fit is None:
            words = (*made.because, *filter(None, [_late_words(report.path)]))
            return Ending(not_judged(*words), made, refusal="; ".join(words))
        asked = acceptance_of(order.acceptance, order.folder, order.serial)
        return Ending(judge_run(made.fit, asked), made)
    except Exception as error:  # noqa: BLE001  the run is sealed: it is told whatever its analysis meets
        crash = f"{type(error).__name__}: {error}"
        return Ending(not_judged(f"the analysis failed: {error}"), crash=crash)


def _late_words(path: Path) -> str:
    from rig.runfile.prevailing import late_words
    from rig.runfile.read import close_recording, open_run

    recording = open_run(path)
    try:
        return late_words(recording.metadata)
    finally:
        close_recording(recording)


def print_ending(out: Console, ending: Ending, path: Path, *, everything: bool) -> None:
    """The values that matter, the tare, and what to do next; with `everything` the whole result."""
    if ending.crash:
        out.print(Text(f"The analysis failed: {ending.crash}", style="red"), soft_wrap=True)
        out.print(
            f"The run is sealed; analyse it anew with: rig fit {quoted(path)}", soft_wrap=True
        )
    if ending.refusal:
        # Its words stand with the verdict.
        out.print(
            f"The run is sealed; its analysis is refused: rig fit {quoted(path)}", soft_wrap=True
        )
    made = ending.digest
    if made is None or made.fit is None:
        return
    from rig.commands.result_tables import print_proof, print_result

    if everything:
        print_result(out, made.fit.result, verdict=ending.verdict, everything=True)
    else:
        for line in _value_lines(ending, made):
            out.print(line, soft_wrap=True)
        print_proof(out, made.fit.result)
    for words in made.fit.tare_words:
        out.print(Text.assemble(("  tare  ", "bold"), words), soft_wrap=True)
    if made.not_stored:
        out.print(Text(f"  not stored: {made.not_stored}", style="yellow"), soft_wrap=True)
    for step in made.next_steps:
        out.print(Text.assemble(("  next  ", "bold"), step), soft_wrap=True)


def _value_lines(ending: Ending, made: Digest) -> list[Text]:
    """At most five values ± U, what is judged before what is not, each with its limit and verdict."""
    from rig.analysis.judging import held_against
    from rig.content.wording import show

    assert made.fit is not None
    result = made.fit.result
    judged = {line.estimate.name: line for line in ending.verdict.lines}
    values = made.key_values
    lines = []
    for title, estimate in sorted(values, key=lambda v: v[1].name not in judged)[:MOST_LINES]:
        if estimate.identifiable == "no":
            # A number that the data do not bear is not shown as one.
            shown = ", ".join(filter(None, ("not identifiable", estimate.note)))
        else:
            shown = show(estimate, result.quantity(estimate.name)).with_uncertainty
        text = Text(f"  {title}: {shown}")
        if estimate.name in judged:
            line = judged[estimate.name]
            text.append(f", limit {held_against(line)[1]}  ")
            text.append(toned(line.outcome))
        lines.append(text)
    more = len(values) - len(lines)
    if more > 0:
        lines.append(Text(f"  and {more} more: --all, or rig fit", style="dim"))
    return lines
