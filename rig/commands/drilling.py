"""`rig drill` and `rig acknowledge`: faults on a simulated rig, and the release of a latched trip by name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.terminal import console, echo, print_json, table

if TYPE_CHECKING:
    from rig.trial.drill.suite import DrillRow


def drill(
    backend: Annotated[
        str | None,
        typer.Option(
            help="Which simulated rig: sim or wire; without it, whichever carries the fault."
        ),
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option("--fault", metavar="NAME", help="Only this fault; may be given again."),
    ] = None,
    random: Annotated[
        int,
        typer.Option(
            "--random", metavar="N", min=0, help="N faults drawn at random, at random cycles."
        ),
    ] = 0,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the simulated rig and of what is random.")
    ] = 0,
    output: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Keep the run files here.")
    ] = None,
    markdown: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the table for the documentation.")
    ] = None,
    list_: Annotated[bool, typer.Option("--list", help="List the faults and exit.")] = False,
    json: Annotated[
        bool,
        typer.Option("--json", help="Print one JSON object on standard output and nothing else."),
    ] = False,
) -> None:
    """Let every fault happen on a simulated rig: what is detected, how soon, how the rig is made
    safe, what the file says.

    Refuses any hardware. Exit code 0 when every drill ended as it must, 6 otherwise.
    """
    from rig.exits import DONE, ERROR
    from rig.trial.drill.suite import chosen, random_drills, random_offset, run_drills

    drills = random_drills(random, seed, backend) if random else chosen(fault or (), backend)
    if list_:
        for one in drills:
            typer.echo(f"{one.name}: {one.what} ({' or '.join(one.carriers)})")
        return
    moved = random_offset(seed) if random else None
    rows: list[DrillRow] = []
    for row in run_drills(drills, backend=backend, seed=seed, output=output, offset=moved):
        rows.append(row)
        if not json:
            typer.echo(
                f"[{len(rows)}/{len(drills)}] {'ok    ' if row.passed else 'FAILED'} {row.fault}",
                err=True,
            )
    if json:
        print_json({"faults": [row.as_json() for row in rows]})
    else:
        _print_table(rows)
    if markdown is not None:
        _write(markdown, rows)
    raise typer.Exit(DONE if all(row.passed for row in rows) else ERROR)


def acknowledge(
    operator: Annotated[str, typer.Option(metavar="NAME", help="Who acknowledges the trip.")],
    output: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the run files.")] = Path(
        "runs"
    ),
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            metavar="FILE",
            help="The rig of hardware (rig.toml): its latch lies with the bench, not with the runs.",
        ),
    ] = None,
    remark: Annotated[
        str, typer.Option(metavar="TEXT", help="What was found and done; kept with the name.")
    ] = "",
    json: Annotated[
        bool,
        typer.Option("--json", help="Print one JSON object on standard output and nothing else."),
    ] = False,
) -> None:
    """Acknowledge a latched trip by name, so that the next run may be started. Nothing starts by itself."""
    from dataclasses import asdict
    from datetime import UTC, datetime

    from rig.bench.backends.registry import HARDWARE
    from rig.bench.identity import bench_of
    from rig.run.latch import latch_of

    backend = "sim" if config is None else HARDWARE
    latch = latch_of(bench_of(backend, output, config))
    now = datetime.now(UTC).isoformat(timespec="seconds")
    trip = latch.acknowledge(operator, now, remark)
    if json:
        print_json({"acknowledged": {**asdict(trip), "by": operator.strip(), "at": now}})
        return
    echo(f"acknowledged by {operator.strip()}: {trip.cause} in run {trip.run}, {trip.time}")
    if not trip.standstill_verified:
        echo(
            "Standstill was NOT verified in that run: look at the rig before it is switched on.",
            err=True,
        )


def _print_table(rows: list[DrillRow]) -> None:
    drills = table(
        "fault",
        "detected",
        "cycles",
        "made safe",
        "stands",
        "verified",
        "outcome",
        "file",
        title="Fault drills",
        title_justify="center",
    )
    for row in rows:
        style = None if row.passed else "bold red"
        drills.add_row(
            row.fault,
            row.detected,
            str(row.cycles),
            row.action,
            _word(row.safe),
            _word(row.verified),
            row.outcome,
            _word(row.file_readable),
            style=style,
        )
    out = console()
    if not out.is_terminal:
        out.width = 180
    out.print(drills)
    failed = [row for row in rows if not row.passed]
    out.print(
        f"{len(rows) - len(failed)} of {len(rows)} drills ended as they must.",
        style="red" if failed else "green",
    )
    for row in failed:
        out.print(
            f"{row.fault}: {row.outcome}, expected {row.expected}. {row.message}",
            soft_wrap=True,
        )


def _write(path: Path, rows: list[DrillRow]) -> None:
    from rig.errors import RigError
    from rig.trial.drill.table import markdown

    try:
        path.write_text(markdown(rows), encoding="utf-8")
    except OSError as error:
        raise RigError(
            f"the table cannot be written: {error.strerror or error}", where=str(path)
        ) from error


def _word(value: bool) -> str:
    return "yes" if value else "NO"
