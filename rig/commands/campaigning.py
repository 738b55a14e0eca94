"""`rig campaign`: a gear taken through its protocols, with one verdict and one certificate at the end."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.judgement import RequireVerdict, acceptance_of
from rig.commands.ordering import OF_MANY_RUNS, NoCard, Said, with_order
from rig.commands.running import ORDERED, Events, Json, StdinControl
from rig.commands.terminal import (
    console,
    outliving_the_terminal,
    painted,
    print_json,
    tell_if_deaf,
)

if TYPE_CHECKING:
    from rig.analysis.passport.content import Alarm
    from rig.bench.backends.order import Order
    from rig.trial.campaign.conduct import CampaignCallbacks, CampaignOrder, CampaignReport
    from rig.trial.campaign.plan import CampaignPlan
    from rig.trial.campaign.walk import Walk


_Name = Annotated[
    str, typer.Argument(metavar="[CAMPAIGN]", help="A campaign that ships; or give --plan.")
]

_Plan = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="A campaign plan of your own (TOML)."),
]

_DryRun = Annotated[
    bool,
    typer.Option("--dry-run", help="Walk all of it without a rig: times and limits, and stop."),
]

_Anew = Annotated[
    bool, typer.Option("--anew", help="Begin again where an unfinished one could go on.")
]

_Junit = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Write runs and limits as JUnit XML, for CI."),
]


@outliving_the_terminal()
@with_order(*(name for name in ORDERED if name != "block_cycles"), world=OF_MANY_RUNS)
def campaign(
    said: Said,
    name: _Name = "",
    plan: _Plan = None,
    dry_run: _DryRun = False,
    anew: _Anew = False,
    junit: _Junit = None,
    require_verdict: RequireVerdict = False,
    no_card: NoCard = False,
    json: Json = False,
    events: Events = False,
    stdin_control: StdinControl = False,
) -> None:
    """Take a gear through a campaign: protocols in order, one verdict, one certificate.

    Every protocol is walked before the first one moves. A trip, an error or a STOP ends the campaign;
    the same command goes on from there, and does again what went out of date. A quantity that breaks its
    limit ends nothing: FAIL is the verdict of the whole.
    """
    from rig.commands.ordering import order_of
    from rig.trial.campaign.walk import walk

    chosen = _plan_of(name, plan)
    if not said.get("serial") and not dry_run:
        raise typer.BadParameter("name the gear by its serial number", param_hint="--gear")
    pattern = order_of(chosen.stages[0].protocol, {}, said, no_card=no_card)
    walked = walk(chosen, pattern)
    if dry_run:
        if json:
            print_json(walked.as_json())
        else:
            _print_walk(walked)
        return
    order = _order_of(walked, pattern, anew=anew)
    _warn_of_what_was_never_tried(pattern)
    tell_if_deaf()
    if events or stdin_control:
        report = _conducted_for_a_program(order, pattern, events, stdin_control)
    else:
        from rig.commands.campaign_callbacks import terminal_callbacks

        with terminal_callbacks(walked, quiet=json) as crew:
            report = _conducted(order, crew, pattern)
    if junit is not None:
        from rig.trial.campaign.junit import write_junit

        write_junit(report.campaign, junit, require_verdict=require_verdict)
    if not events:
        _tell(report, json)
    raise typer.Exit(_code_of(report.campaign, require_verdict))


def _tell(report: _Conducted, json: bool) -> None:
    if json:
        print_json(report.as_json())
    else:
        _print_report(report.campaign, report.certificate)
        _print_alarms(report)


@dataclass(frozen=True)
class _Conducted:
    """A campaign as far as it came, the files of its certificate, and what has changed with the gear over its runs, or
    why nobody can tell.
    """

    campaign: CampaignReport
    certificate: list[str]
    alarms: tuple[Alarm, ...] = ()
    untold: str = ""

    def as_json(self) -> dict[str, Any]:
        """The object that `rig campaign --json` prints."""
        return {
            **self.campaign.as_json(),
            "certificate": self.certificate,
            "alarms": [one.as_json() for one in self.alarms],
            "alarms_untold": self.untold,
        }


def _code_of(report: CampaignReport, require_verdict: bool) -> int:
    """First what stopped it, then an analysis that crashed, then the verdict."""
    from rig import exits

    if report.is_complete and report.problems:
        return exits.ERROR
    return exits.code_of_run(report.outcome, report.verdict.verdict, required=require_verdict)


def _plan_of(name: str, path: Path | None) -> CampaignPlan:
    from rig.trial.campaign.plan import load_plan, shipped_names, shipped_plan

    if bool(name) == (path is not None):
        raise typer.BadParameter(
            f"name a campaign ({', '.join(shipped_names())}) or give a plan with --plan, one of the two",
            param_hint="CAMPAIGN",
        )
    return load_plan(path) if path is not None else shipped_plan(name)


def _order_of(walked: Walk, pattern: Order, *, anew: bool) -> CampaignOrder:
    from rig.bench.backends.registry import is_simulated
    from rig.gears.card import now_text
    from rig.run.start import bench_for
    from rig.trial.campaign.conduct import CampaignOrder

    return CampaignOrder(
        walk=walked,
        bench=bench_for(pattern).id,
        now=now_text,
        acceptance=acceptance_of(pattern.acceptance, pattern.folder, pattern.serial),
        beside=is_simulated(pattern.backend),
        anew=anew,
    )


def _warn_of_what_was_never_tried(pattern: Order) -> None:
    """Which stages of its commissioning a bench of hardware lacks; each run asks again, and asks the devices."""
    from rig.bench.backends.registry import HARDWARE
    from rig.commands.terminal import echo
    from rig.run.commissioned import standing_of
    from rig.run.start import bench_for

    if pattern.backend != HARDWARE:
        return
    missing = standing_of(bench_for(pattern), pattern).missing()
    if missing:
        text = f"warning: never commissioned: {', '.join(map(str, missing))}; simulated devices need none"
        echo(text, errors=True)


def _conducted(order: CampaignOrder, crew: CampaignCallbacks, pattern: Order) -> _Conducted:
    from rig.trial.campaign.conduct import conduct

    report = conduct(order, crew)
    certificate = _certificate(report, order, pattern)
    # An analysis that crashed is made again by the same command: the campaign is not over.
    if report.is_complete and not report.problems:
        report.journal.with_end(
            report.verdict.verdict,
            ", ".join(certificate),
            order.now(),
            _rests_on(report, certificate),
        )
    return _Conducted(report, certificate, *_alarms(report, pattern))


def _alarms(report: CampaignReport, pattern: Order) -> tuple[tuple[Alarm, ...], str]:
    """What has changed with the gear, and why nobody can tell: an older run that was altered is no matter of this
    campaign, whose end is told all the same.
    """
    from rig.analysis.alarm.laboratory import watching_in_force
    from rig.analysis.passport.build import alarms_of
    from rig.errors import RigError

    if not report.verdict_rests_on:
        return (), ""
    try:
        return alarms_of(pattern.folder, pattern.serial, watching_in_force(pattern.config)), ""
    except RigError as error:
        return (), str(error)


def _rests_on(report: CampaignReport, certificate: list[str]) -> dict[str, Any]:
    """What the end of a campaign names by its hash: what the gear had to show, and the certificate."""
    from rig.runfile.seal import file_sha256

    return {
        "acceptance": report.verdict.source,
        "acceptance_sha256": report.verdict.acceptance_sha256,
        "certificates": [
            {"name": Path(path).name, "sha256": file_sha256(Path(path))} for path in certificate
        ],
    }


def _conducted_for_a_program(
    order: CampaignOrder, pattern: Order, events: bool, stdin_control: bool
) -> _Conducted:
    """A campaign whose operator is another program: words on standard input, lines of JSON on standard output."""
    from drivers.clock import WallClock
    from rig.analysis.store import json_ready
    from rig.commands.campaign_callbacks import program_callbacks
    from rig.run.remote import RemoteOperator
    from rig.run.stop import StopRequest

    def write(line: str) -> None:
        if events:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()

    stop = StopRequest()
    remote = RemoteOperator(stop, write, WallClock())
    with program_callbacks(order.walk, remote, stop, listens=stdin_control) as crew:
        conducted = _conducted(order, crew, pattern)
    remote.report(json_ready(conducted.as_json()))
    return conducted


def _certificate(report: CampaignReport, order: CampaignOrder, pattern: Order) -> list[str]:
    """Write the certificate of a campaign beside its runs, HTML and PDF; the paths, none where nothing is analysed."""
    from rig.present.certificate.laboratory import laboratory_of
    from rig.present.certificate.write import write_certificate

    if not report.verdict_rests_on:
        return []
    stem = report.journal.path.stem
    outputs = [pattern.folder / f"certificate-{stem}{suffix}" for suffix in (".html", ".pdf")]
    certificate = write_certificate(
        pattern.folder,
        pattern.serial,
        outputs,
        acceptance=order.acceptance,
        protocols=[one.order.protocol for one in report.walk.stages],
        laboratory=laboratory_of(pattern.config),
    )
    return [str(path) for path in certificate.paths]


def _print_walk(walked: Walk) -> None:
    from rig.run.progress import in_words
    from rig.trial.campaign.walk import walk_grid

    out = console()
    out.print(painted(walk_grid(walked).without("done as")))
    out.print(
        f"in all {in_words(walked.nominal)} nominal, {in_words(walked.longest)} at most, prompts not counted"
    )


def _print_alarms(conducted: _Conducted) -> None:
    """What has changed with the gear over all its runs, and the run that decides."""
    out = console()
    if conducted.untold:
        text = f"Whether the gear has changed cannot be told: {conducted.untold}"
        out.print(text, style="yellow", soft_wrap=True)
    for alarm in conducted.alarms:
        out.print(f"CHANGED  {alarm.sentence}", style="bold red", soft_wrap=True)
        out.print(f"  {alarm.decides}  →  {alarm.command}", soft_wrap=True)


def _print_report(report: CampaignReport, certificate: list[str]) -> None:
    """How a campaign stands: its runs, the verdict with its reasons, the certificate, what to do next."""
    from rig.commands.result_tables import print_verdict
    from rig.content.grid import Grid, columns

    out = console()
    for words in report.resumed:
        out.print(words, soft_wrap=True)
    done = {run.index: (run.run, run.outcome) for run in report.journal.stages}
    rows = [
        (one.order.protocol, *done.get(index, ("not run", "-")))
        for index, one in enumerate(report.walk.stages)
    ]
    out.print(painted(Grid("", columns("protocol", "run", "outcome"), rows)))
    for problem in report.problems:
        out.print(f"analysis: {problem}", style="red", soft_wrap=True)
    state = "" if report.is_complete else "INCOMPLETE, "
    out.print(f"{state}outcome {report.outcome}", style="bold")
    print_verdict(out, report.verdict)
    for path in certificate:
        out.print(f"certificate  {path}", soft_wrap=True)
    order = report.walk.stages[0].order
    serial, where = shlex.quote(order.serial), shlex.quote(str(order.folder))
    if done and order.serial:
        out.print(f"all of it    rig report --gear {serial} --runs {where}", soft_wrap=True)
    if not report.is_complete:
        out.print("The same command goes on from here.")
