"""`rig commission`: a bench met for the first time, stage by stage."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.ordering import NoCard, Said, with_order
from rig.commands.terminal import console, echo, outliving_the_terminal, painted, print_json

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rig.bench.backends.order import Order
    from rig.bench.commissioning import Missing, Stage, StageDone
    from rig.bench.identity import Bench
    from rig.trial.commission.work import Seen


@outliving_the_terminal()
@with_order(
    "backend",
    "config",
    "operator",
    "serial",
    "mounting",
    "gear",
    "sample_rate",
    "folder",
    "seed",
    backend="Which rig: hardware (the default, see --config), or wire to see how it goes.",
)
def commission(
    said: Said,
    stages: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[STAGE]...", help="Only these; without, every one that is missing."
        ),
    ] = None,
    confirm: Annotated[
        str,
        typer.Option(metavar="SERIAL", help="Arms it: the gear's serial number once more."),
    ] = "",
    list_: Annotated[
        bool, typer.Option("--list", help="The stages, what each shows, what is missing; exit.")
    ] = False,
    no_card: NoCard = False,
    json: Annotated[
        bool,
        typer.Option("--json", help="Print one JSON object on standard output and nothing else."),
    ] = False,
) -> None:
    """Take a new bench through its first hour, stage by stage; what was done is kept, and goes on where it stopped.

    Listen, read, turn by hand, 30 r/min without the gear, every stop tried and timed, one turn of the output, full
    speed. Before each stage it says what is done and what must be seen, and asks for a typed yes. `rig run` on hardware
    asks for it: before, nothing turns faster than 30 r/min or further than once. Exit code 6 when a stage failed, 4
    when it was stopped.
    """
    from rig import exits
    from rig.bench.backends.registry import HARDWARE
    from rig.commands.ordering import confirmed, order_of
    from rig.run.arming import refuse_unarmed
    from rig.run.bench_lock import bench_lock
    from rig.run.start import arming_of, bench_for, plan_order
    from rig.trial.commission.conduct import missing_of, stages_to_do
    from rig.trial.doctor.motion import EXPERIMENT

    order = order_of("commission", {}, {"backend": HARDWARE, **said}, no_card=no_card)
    _refuse_without_a_bus(order.backend)
    bench, description = bench_for(order), _description(order)
    missing = missing_of(bench, description)
    if list_:
        _list(bench, missing, json)
        return
    to_do = stages_to_do(missing, stages or ())
    if order.backend == HARDWARE:
        planned = plan_order(order, EXPERIMENT)
        confirmation = confirmed(order, planned, confirm, not json)
        refuse_unarmed(arming_of(order, planned, confirmation))
    done: dict[str, Seen] = {}
    stopped = False
    with bench_lock(bench, "rig commission"):
        for stage in to_do:
            seen, stopped = _one(stage, order, bench, description, quiet=json)
            done[stage.name] = seen
            if stopped or not seen.is_fine:
                break
    missing = missing_of(bench, description)
    if json:
        print_json(_as_json(done, missing))
    else:
        _ending(done, missing)
    if stopped:
        raise typer.Exit(exits.ABORTED)
    if not all(seen.is_fine for seen in done.values()):
        raise typer.Exit(exits.ERROR)


def _one(
    stage: Stage, order: Order, bench: Bench, description: str, *, quiet: bool
) -> tuple[Seen, bool]:
    """One stage with its own STOP; what was seen, and whether the operator stopped it."""
    from rig.commands.prompting import terminal_ask
    from rig.run.stop import StopRequest, pressed_by_signals
    from rig.trial.commission.conduct import do_stage
    from rig.trial.commission.work import Work

    if not quiet:
        echo(
            f"\n{stage.name} (gear {stage.gear})\n  done: {stage.does}\n  must be seen: {stage.must_be_seen}"
        )
    stop = StopRequest()
    work = Work(
        order=order,
        bench=bench,
        ask=terminal_ask(stop),
        stop=stop,
        now=lambda: datetime.now(UTC).isoformat(timespec="seconds"),
    )
    with pressed_by_signals(stop):
        seen = do_stage(stage, work, description)
    if not quiet:
        from rig.commands.findings import print_findings

        print_findings({stage.name: seen.findings})
    return seen, bool(stop.level) and stage.name != "stop-key"


def _refuse_without_a_bus(backend: str) -> None:
    from rig.bench.backends.registry import HARDWARE
    from rig.errors import ConfigurationError

    if backend != HARDWARE and not backend.startswith("wire"):
        raise ConfigurationError(
            "has no devices that could be met",
            where="--backend",
            value=backend,
            limit="hardware; wire, wire-csp, wire-box, wire-analog to see how it goes",
        )


def _description(order: Order) -> str:
    """The hash of what describes the rig; a simulated one describes itself."""
    from rig.bench.backends.registry import HARDWARE
    from rig.bench.config.described import description_hash
    from rig.bench.config.load import load_configuration
    from rig.bench.config.place import DEFAULT_PATH

    if order.backend != HARDWARE:
        return order.backend
    return description_hash(load_configuration(order.config or DEFAULT_PATH))


def _list(bench: Bench, missing: Sequence[Missing], json: bool) -> None:
    from rig.bench.commissioning import STAGES, read_record

    newest: Mapping[str, StageDone] = {done.stage: done for done in read_record(bench.state)}
    reasons = {one.stage: one.reason for one in missing}
    if json:
        stages = [
            {
                "stage": stage.name,
                "gear": stage.gear,
                "does": stage.does,
                "must_be_seen": stage.must_be_seen,
                "missing": reasons.get(stage.name, ""),
                "at": newest[stage.name].at if stage.name in newest else None,
                "operator": newest[stage.name].operator if stage.name in newest else None,
            }
            for stage in STAGES
        ]
        print_json({"bench": bench.id, "stages": stages})
        return
    from rig.content.grid import Grid, columns

    rows = [
        (stage.name, reasons.get(stage.name) or _by(newest[stage.name]), stage.gear, stage.does)
        for stage in STAGES
    ]
    headings = columns("stage", "state", "gear", ("what is done", "sentence"))
    console().print(painted(Grid("", headings, rows)))


def _by(done: StageDone) -> str:
    return f"{done.at[:10]}, {done.operator or 'nobody'}"


def _ending(done: Mapping[str, Seen], missing: Sequence[Missing]) -> None:
    if not done:
        echo("Nothing is missing: every stage was done with this description.")
        return
    left = f"still missing: {', '.join(map(str, missing))}" if missing else "every stage is done"
    echo(f"\n{len(done)} stages, {left}")


def _as_json(done: Mapping[str, Seen], missing: Sequence[Missing]) -> dict[str, Any]:
    return {
        "ok": all(seen.is_fine for seen in done.values()),
        "stages": {
            name: {
                "passed": seen.is_fine,
                "findings": [finding.as_json() for finding in seen.findings],
                "answers": seen.answers,
                "runs": seen.runs,
            }
            for name, seen in done.items()
        },
        "missing": [vars(one) for one in missing],
    }
