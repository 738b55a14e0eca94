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

from rig.commands.running import MountedHow, StdinControl
from rig.commands.terminal import echo, outliving_the_terminal, print_json

if TYPE_CHECKING:
    from experiments.finding import Finding
    from rig.run.start import RunRequest
    from rig.trial.doctor.examine import Examination


@outliving_the_terminal()
def doctor(
    backend: Annotated[
        str, typer.Option(help="Which rig: sim, wire, or hardware (see --config).")
    ] = "sim",
    config: Annotated[
        Path | None,
        typer.Option("--config", metavar="FILE", help="The rig's configuration (rig.toml)."),
    ] = None,
    gear_serial: Annotated[
        str, typer.Option("--gear", metavar="SERIAL", help="Serial number of the gear.")
    ] = "unknown",
    mounting: MountedHow = None,
    parameters: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Parameter set of the gear (TOML).")
    ] = None,
    sample_rate: Annotated[
        float | None,
        typer.Option("--sample-rate", metavar="HZ", min=50.0, max=20000.0, help="SYNC rate [Hz]."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--runs", metavar="DIR", help="Folder of the runs: where the disk is looked at."
        ),
    ] = None,
    operator: Annotated[
        str, typer.Option(metavar="NAME", help="Who does it; needed where hardware is to move.")
    ] = "",
    confirm: Annotated[
        str,
        typer.Option(
            metavar="SERIAL", help="Arms motion on hardware: the gear's serial number once more."
        ),
    ] = "",
    move: Annotated[
        bool | None,
        typer.Option(
            "--move/--no-move",
            "--motion/--no-motion",
            help="Whether the rig may turn; without it only a simulated one does.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of a simulated rig.")] = 0,
    stdin_control: StdinControl = False,
    json: Annotated[
        bool,
        typer.Option("--json", help="Print one JSON object on standard output and nothing else."),
    ] = False,
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
    from rig.commands.ordering import confirmed, request_of
    from rig.run.arming import refuse_unarmed
    from rig.run.remote import RemoteOperator, lines_of
    from rig.run.start import arming_of, plan_request, rig_for
    from rig.run.stop import StopRequest, pressed_by_signals
    from rig.trial.doctor.examine import examine, readout_of
    from rig.trial.doctor.motion import EXPERIMENT

    _refuse_a_replay(backend)
    request = request_of(
        "doctor",
        {},
        backend=backend,
        config=config,
        parameters=parameters,
        mounting=mounting,
        sample_rate=sample_rate,
        output=output,
        gear_serial=gear_serial,
        operator=operator,
        seed=seed,
        confirmation=confirm,
    )
    planned = plan_request(request, EXPERIMENT)
    moves = move if move is not None else backend != HARDWARE
    if moves:
        request = confirmed(request, planned, asks=not (json or stdin_control))
        if backend == HARDWARE:
            refuse_unarmed(arming_of(request, planned))
    stop = StopRequest()
    remote = RemoteOperator(stop, partial(print, flush=True), WallClock())
    if stdin_control:
        remote.listen_in_background(lines_of(sys.stdin.fileno()))
    with _bench_of_its_own(request, moves), pressed_by_signals(stop):
        examination = examine(
            lambda: rig_for(request, planned),
            request,
            moves=moves,
            why_not="asked not to move; --move lets it",
            serial_line=readout_of(request),
            stop=stop,
            on_stage=lambda stage: (
                None if json or stdin_control else echo(f"{stage} ...", errors=True)
            ),
        )
    if stdin_control:
        remote.report(json_ready(examination.as_json()))
    elif json:
        print_json(examination.as_json())
    else:
        _print(examination)
    raise typer.Exit(
        exits.ABORTED
        if examination.was_stopped
        else exits.DONE
        if examination.is_fine
        else exits.ERROR
    )


@contextmanager
def _bench_of_its_own(request: RunRequest, moves: bool) -> Iterator[None]:
    """The bench for the time of the examination: connecting alone takes the nodes from whoever runs there."""
    from rig.errors import ConfigurationError
    from rig.run.bench_lock import bench_lock
    from rig.run.latch import latch_of
    from rig.run.start import bench_for

    try:
        bench = bench_for(request)
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


def _print(examination: Examination) -> None:
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
