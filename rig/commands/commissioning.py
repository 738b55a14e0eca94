"""`rig commission`: a bench met for the first time, stage by stage."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.ordering import NoCard, Said, with_order
from rig.commands.running import Events, StdinControl
from rig.commands.terminal import Json, console, echo, outliving_the_terminal, painted, print_json
from rig.content.phrase import phrase

if TYPE_CHECKING:
    from pathlib import Path

    from rig.bench.backends.order import Order
    from rig.bench.commissioning import Missing, Stage, StageDone
    from rig.bench.identity import Bench
    from rig.run.remote import RemoteOperator
    from rig.run.stop import StopRequest
    from rig.trial.commission.work import Seen, Work


_OUTCOMES = {True: "COMPLETED", False: "ERROR"}
"""How stages end, by whether what was seen of them is fine."""

_Stages = Annotated[
    list[str] | None,
    typer.Argument(metavar="[STAGE]...", help="Only these; without, every one that is missing."),
]

_Confirm = Annotated[
    str,
    typer.Option(metavar="SERIAL", help="Arms it: the gear's serial number once more."),
]

_List = Annotated[
    bool, typer.Option("--list", help="The stages, what each shows, what is missing; exit.")
]


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
    stages: _Stages = None,
    confirm: _Confirm = "",
    list_: _List = False,
    no_card: NoCard = False,
    json: Json = False,
    events: Events = False,
    stdin_control: StdinControl = False,
) -> None:
    """Take a new bench through its first hour, stage by stage; what was done is kept, and goes on where it stopped.

    Listen, read, turn by hand, 30 r/min without the gear, every stop tried and timed, one turn of the output, full
    speed. Before each stage it says what is done and what must be seen, and asks for a typed yes. `rig run` on hardware
    asks for it: before, nothing turns faster than 30 r/min or further than once. Exit code 6 when a stage failed, 4
    when it was stopped.
    """
    from rig import exits
    from rig.bench.backends.registry import HARDWARE
    from rig.commands.ordering import order_of
    from rig.run.start import bench_for
    from rig.trial.commission.conduct import missing_of, stages_to_do
    from rig.trial.commission.record import seal_record

    order = order_of("commission", {}, {"backend": HARDWARE, **said}, no_card=no_card)
    _refuse_without_a_bus(order.backend)
    bench, description = bench_for(order), _description(order)
    missing = missing_of(bench, description)
    if list_:
        _list(bench, missing, json)
        return
    to_do = stages_to_do(missing, stages or ())
    by_a_program = events or stdin_control
    if order.backend == HARDWARE:
        _arm(order, confirm, asks=not (json or by_a_program))
    crew = _Program(order, to_do, listens=stdin_control) if by_a_program else _Terminal(quiet=json)
    done, stopped = _conducted(to_do, order, bench, description, crew)
    missing = missing_of(bench, description)
    record = seal_record(bench, order.folder, description, _now()) if done else None
    crew.over(done, missing, record)
    if json and not by_a_program:
        print_json(_as_json(done, missing, record))
    if stopped:
        raise typer.Exit(exits.ABORTED)
    if not all(seen.is_fine for seen in done.values()):
        raise typer.Exit(exits.ERROR)


def _arm(order: Order, confirm: str, *, asks: bool) -> None:
    from rig.commands.ordering import confirmed
    from rig.run.arming import refuse_unarmed
    from rig.run.start import arming_of, plan_order
    from rig.trial.doctor.motion import EXPERIMENT

    planned = plan_order(order, EXPERIMENT)
    refuse_unarmed(arming_of(order, planned, confirmed(order, planned, confirm, asks)))


def _conducted(
    to_do: Sequence[Stage],
    order: Order,
    bench: Bench,
    description: str,
    crew: _Terminal | _Program,
) -> tuple[dict[str, Seen], bool]:
    """Every stage with a STOP of its own, up to the first that fails; and whether the operator stopped it."""
    from rig.run.bench_lock import bench_lock
    from rig.run.stop import StopRequest, pressed_by_signals
    from rig.trial.commission.conduct import do_stage

    done: dict[str, Seen] = {}
    stopped = False
    with bench_lock(bench, "rig commission"):
        for index, stage in enumerate(to_do):
            stop = StopRequest()
            work = crew.work(order, bench, stop)
            crew.begun(index, stage)
            with pressed_by_signals(stop):
                done[stage.name] = do_stage(stage, work, description)
            crew.ended(index, stage, done[stage.name])
            stopped = bool(stop.level) and stage.name != "stop-key"
            if stopped or not done[stage.name].is_fine:
                break
    return done, stopped


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


class _Terminal:
    """Whoever sits at the terminal."""

    def __init__(self, *, quiet: bool) -> None:
        self._quiet = quiet

    def work(self, order: Order, bench: Bench, stop: StopRequest) -> Work:
        from rig.commands.prompting import terminal_ask
        from rig.trial.commission.work import Work

        return Work(order=order, bench=bench, ask=terminal_ask(stop), stop=stop, now=_now)

    def begun(self, index: int, stage: Stage) -> None:
        if not self._quiet:
            heading = f"\n{stage.name} (gear {stage.gear})"
            echo(f"{heading}\n  done: {stage.does}\n  must be seen: {stage.must_be_seen}")

    def ended(self, index: int, stage: Stage, seen: Seen) -> None:
        from rig.commands.findings import print_findings

        if not self._quiet:
            print_findings({stage.name: seen.findings})

    def over(
        self, done: Mapping[str, Seen], missing: Sequence[Missing], record: Path | None
    ) -> None:
        if not self._quiet:
            echo("\n".join(_lines(done, missing, record)))


class _Program:
    """Another program: it hears the stages as those of a campaign, and answers."""

    def __init__(self, order: Order, to_do: Sequence[Stage], *, listens: bool) -> None:
        from drivers.clock import WallClock
        from rig.run.remote import RemoteOperator, lines_of
        from rig.run.stop import StopRequest

        self._gear = order.serial
        self._remote: RemoteOperator = RemoteOperator(StopRequest(), _print_line, WallClock())
        if listens:
            self._remote.listen_in_background(lines_of(sys.stdin.fileno()))
        rows = [{"protocol": stage.name, "nominal": 0.0, "longest": 0.0} for stage in to_do]
        self._remote.tell("campaign", {**self._named(), "title": "commissioning", "stages": rows})

    def _named(self) -> dict[str, str]:
        return {"campaign": "commissioning", "gear": self._gear}

    def work(self, order: Order, bench: Bench, stop: StopRequest) -> Work:
        from rig.trial.commission.work import Work

        self._remote.serve(stop)
        return Work(
            order=order,
            bench=bench,
            ask=self._remote.ask,
            stop=stop,
            now=_now,
            on_progress=self._remote.on_progress,
            on_event=self._remote.on_event,
        )

    def begun(self, index: int, stage: Stage) -> None:
        told = {"index": index, "protocol": stage.name, "state": "begun"}
        self._remote.tell("stage", {**told, "does": stage.does, "must_be_seen": stage.must_be_seen})

    def ended(self, index: int, stage: Stage, seen: Seen) -> None:
        failed = "; ".join(one.sentence for one in seen.findings if one.severity == "blocks")
        run = seen.latest
        path, rows = ("", 0) if run is None else (str(run.path), run.rows)
        outcome = _OUTCOMES[seen.is_fine]
        report: dict[str, Any] = {
            "outcome": outcome,
            "message": failed,
            "path": path,
            "rows": rows,
            # What did not turn stands; what a stage let somebody stop was seen to stand, or the stage has failed.
            "make_safe": {"safe": run is None or run.safe or seen.is_fine},
        }
        told = {"index": index, "protocol": stage.name, "state": "ended", "run": ""}
        self._remote.tell(
            "stage", {**told, "outcome": outcome, "message": failed, "report": report}
        )

    def over(
        self, done: Mapping[str, Seen], missing: Sequence[Missing], record: Path | None
    ) -> None:
        fine = all(seen.is_fine for seen in done.values())
        self._remote.report(
            {
                **self._named(),
                **_as_json(done, missing, record),
                "complete": fine,
                "outcome": _OUTCOMES[fine],
                "verdict": "stages are missing" if missing else "every stage is done",
                "lines": _lines(done, missing, record),
            }
        )


def _print_line(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


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
                "at": (done := newest.get(stage.name)) and done.at,
                "operator": done and done.operator,
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


def _lines(done: Mapping[str, Seen], missing: Sequence[Missing], record: Path | None) -> list[str]:
    """How it stands, in lines."""
    if not done:
        return ["Nothing is missing: every stage was done with this description."]
    left = phrase("still missing: {}", ", ".join(map(str, missing))) or "every stage is done"
    failed = [f"{name} failed" for name, seen in done.items() if not seen.is_fine]
    lines = ["; ".join([f"{len(done)} stages", *failed, left])]
    if record is not None:
        lines.append(f"record  {record}")
    return lines


def _as_json(
    done: Mapping[str, Seen], missing: Sequence[Missing], record: Path | None
) -> dict[str, Any]:
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
        "record": record,
    }
