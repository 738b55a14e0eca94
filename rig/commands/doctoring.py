"""`rig doctor`: the rig looked over, every line with its evidence."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.ordering import NoCard, Said, with_order
from rig.commands.running import StdinControl
from rig.commands.terminal import Json, echo, outliving_the_terminal, print_json

if TYPE_CHECKING:
    from experiments.finding import Finding
    from rig.bench.backends.assembly import AssembledRig
    from rig.bench.backends.order import Order
    from rig.run.dry_run import PlannedRun
    from rig.run.stop import StopRequest
    from rig.trial.doctor.examine import Examination


_Confirm = Annotated[
    str,
    typer.Option(
        metavar="SERIAL", help="Arms motion on hardware: the gear's serial number once more."
    ),
]

_Move = Annotated[
    bool | None,
    typer.Option(
        "--move/--no-move",
        "--motion/--no-motion",
        help="Whether the rig may turn; without it only a simulated one does.",
    ),
]

_Bundle = Annotated[
    Path | None,
    typer.Option(
        "--bundle",
        metavar="FILE",
        help="Pack checklist, description, nodes, frames and versions for a report of a device; names no person.",
    ),
]


@outliving_the_terminal()
@with_order(
    "backend",
    "config",
    "serial",
    "mounting",
    "gear",
    "sample_rate",
    "folder",
    "operator",
    "seed",
)
def doctor(
    said: Said,
    confirm: _Confirm = "",
    move: _Move = None,
    bundle: _Bundle = None,
    no_card: NoCard = False,
    stdin_control: StdinControl = False,
    json: Json = False,
) -> None:
    """Look a rig over and print a checklist with evidence; exit code 6 when a line of it failed, 4 when it was stopped.

    Standing: nodes, identities, firmware, states, heartbeats, missing objects, limits, zero and
    noise, rate and jitter, calibrations, disk, clock, readout. In motion: a degree of creep, a turn
    of the input, a turn of the output: which way both encoders count, and whether the ratio is the
    one that was described. Motion on hardware is armed as a run is.
    """
    from drivers.clock import WallClock
    from rig import exits
    from rig.analysis.store import json_ready
    from rig.bench.backends.registry import HARDWARE
    from rig.commands.ordering import order_of
    from rig.run.remote import RemoteOperator, lines_of
    from rig.run.start import plan_order
    from rig.run.stop import StopRequest
    from rig.trial.doctor.motion import EXPERIMENT

    _refuse_a_replay(said.get("backend", ""))
    order = order_of("doctor", {}, said, no_card=no_card)
    planned = plan_order(order, EXPERIMENT)
    moves = move if move is not None else order.backend != HARDWARE
    if moves:
        _arm(order, planned, confirm, asks=not (json or stdin_control))
    stop = StopRequest()
    remote = RemoteOperator(stop, partial(print, flush=True), WallClock())
    if stdin_control:
        remote.listen_in_background(lines_of(sys.stdin.fileno()))
    examination, packed = _examined(
        order, planned, stop, bundle, moves=moves, quiet=json or stdin_control
    )
    if stdin_control:
        remote.report(json_ready(examination.as_json()))
    elif json:
        print_json(examination.as_json())
    else:
        _print(examination, bundle, packed)
    if examination.was_stopped:
        raise typer.Exit(exits.ABORTED)
    raise typer.Exit(exits.code_of_check(examination.is_fine))


def _examined(
    order: Order,
    planned: PlannedRun,
    stop: StopRequest,
    bundle: Path | None,
    *,
    moves: bool,
    quiet: bool,
) -> tuple[Examination, tuple[str, ...]]:
    """What was found of a rig, on its bench alone, and what was packed of it."""
    from rig.run.start import rig_for
    from rig.run.stop import pressed_by_signals
    from rig.trial.doctor.examine import examine, readout_of

    made: list[AssembledRig] = []

    def make() -> AssembledRig:
        made.append(rig_for(order, planned))
        return made[-1]

    def on_stage(stage: str) -> None:
        if not quiet:
            echo(f"{stage} ...", errors=True)

    with _bench_of_its_own(order, moves), pressed_by_signals(stop):
        examination = examine(
            make,
            order,
            moves=moves,
            why_not="asked not to move; --move lets it",
            serial_line=readout_of(order),
            stop=stop,
            on_stage=on_stage,
        )
        return examination, _bundle(bundle, examination, made, order)


def _arm(order: Order, planned: PlannedRun, confirm: str, *, asks: bool) -> None:
    """Refuse motion on hardware that nobody armed."""
    from rig.bench.backends.registry import HARDWARE
    from rig.commands.ordering import confirmed
    from rig.run.arming import refuse_unarmed
    from rig.run.start import arming_of

    confirmation = confirmed(order, planned, confirm, asks)
    if order.backend == HARDWARE:
        refuse_unarmed(arming_of(order, planned, confirmation))


def _bundle(
    path: Path | None, examination: Examination, rigs: list[AssembledRig], order: Order
) -> tuple[str, ...]:
    """Pack what was found, while the bench is still this program's own; what is in it."""
    from rig.errors import ConfigurationError
    from rig.run.start import bench_for
    from rig.trial.doctor.bundle import write_bundle

    if path is None:
        return ()
    try:
        bench = bench_for(order)
    except ConfigurationError:
        bench = None
    return write_bundle(path, examination, rigs, bench, order.config)


@contextmanager
def _bench_of_its_own(order: Order, moves: bool) -> Iterator[None]:
    """The bench for the time of the examination: connecting alone takes the nodes from whoever runs there."""
    from rig.errors import ConfigurationError
    from rig.run.bench_lock import bench_lock
    from rig.run.latch import latch_of
    from rig.run.start import bench_for

    try:
        bench = bench_for(order)
    except ConfigurationError:
        # A bench that cannot be told from others is a line of the checklist, and must not move.
        if moves:
            raise
        yield
        return
    with bench_lock(bench, "rig doctor"):
        if moves:
            latch_of(bench).refuse()
        yield


def _refuse_a_replay(backend: str) -> None:
    from rig.bench.backends.registry import REPLAY
    from rig.errors import ConfigurationError

    if backend.startswith(REPLAY):
        raise ConfigurationError(
            "a recorded run is no rig that could be looked over",
            where="--backend",
            value=backend,
            limit="sim, wire, hardware",
            remedy="What was recorded is told by `rig show`.",
        )


def _print(
    examination: Examination, bundle: Path | None = None, packed: tuple[str, ...] = ()
) -> None:
    from experiments.finding import Severity
    from rig.commands.findings import print_findings

    echo(f"rig doctor: {examination.backend}")
    groups: dict[str, list[Finding]] = {}
    for finding in examination.findings:
        groups.setdefault(finding.where, []).append(finding)
    print_findings(groups)
    count = Counter(finding.severity for finding in examination.findings)
    echo(
        f"{len(examination.findings)} lines, {count[Severity.BLOCKS]} failed, "
        f"{count[Severity.WARNS]} warnings, {count[Severity.NOT_LOOKED_AT]} not looked at"
    )
    if packed:
        echo(f"{bundle}: {', '.join(packed)}")
