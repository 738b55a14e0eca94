"""`rig sim drill` and `rig acknowledge`: faults on a simulated rig, and the release of a latched trip by name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.terminal import Json, console, echo, painted, print_json

if TYPE_CHECKING:
    from rig.trial.drill.catalogue import Drill
    from rig.trial.drill.suite import DrillRow


_Backend = Annotated[
    str | None,
    typer.Option(
        help="Which simulated rig: sim, wire, wire-box, wire-csp, wire-pv, wire-analog; without it, whichever "
        "carries the fault."
    ),
]

_Fault = Annotated[
    list[str] | None,
    typer.Option("--fault", metavar="NAME", help="Only this fault; may be given again."),
]

_Random = Annotated[
    int,
    typer.Option(
        "--random", metavar="N", min=0, help="N faults drawn at random, at random cycles."
    ),
]

_Pairs = Annotated[
    int,
    typer.Option(
        "--pairs",
        metavar="N",
        min=0,
        help="N pairs of faults drawn at random, at random moments of one run.",
    ),
]

_WithoutFaults = Annotated[
    bool,
    typer.Option(
        "--without-faults",
        help="Take every fault out: each drill that claims a detection must then fail.",
    ),
]

_Compensated = Annotated[
    bool,
    typer.Option("--compensated", help="Turn along a compensation table while the fault happens."),
]

_Seed = Annotated[int, typer.Option(min=0, help="Seed of the simulated rig and of what is random.")]

_Output = Annotated[
    Path | None, typer.Option("--runs", metavar="DIR", help="Keep the run files here.")
]

_Markdown = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Write the table for the documentation.")
]


def drill(
    backend: _Backend = None,
    fault: _Fault = None,
    random: _Random = 0,
    pairs: _Pairs = 0,
    without_faults: _WithoutFaults = False,
    compensated: _Compensated = False,
    seed: _Seed = 0,
    output: _Output = None,
    markdown: _Markdown = None,
    list_: Annotated[bool, typer.Option("--list", help="List the faults and exit.")] = False,
    json: Json = False,
) -> None:
    """Let every fault happen on a simulated rig: what is detected, how soon, how the rig is made
    safe, what the file says.

    Refuses any hardware. Exit code 0 when every drill ended as it must, 6 otherwise. With
    --without-faults nothing goes wrong, and it is 0 only when every drill that claims a detection
    fails. With --pairs it is 0 when every pair ends safe and the program says so.
    """
    from rig.exits import code_of_check
    from rig.trial.drill.suite import (
        chosen,
        proves_detection,
        random_drills,
        random_offset,
        run_drills,
    )

    _refuse_together(
        pairs=pairs, without_faults=without_faults, fault=fault, random=random, markdown=markdown
    )
    if pairs:
        raise typer.Exit(code_of_check(_run_pairs(pairs, seed, backend, output, json)))
    drills = random_drills(random, seed, backend) if random else chosen(fault or (), backend)
    if list_:
        _print_list(drills)
        return

    def run(without: bool) -> list[DrillRow]:
        rows = run_drills(
            drills,
            backend=backend,
            seed=seed,
            output=output,
            offset=random_offset(seed) if random else None,
            without_faults=without,
            is_compensated=compensated,
        )
        missed = "fails " if without else "FAILED"
        return list(rows) if json else list(_told_of_each(rows, len(drills), missed))

    rows = run(without_faults)
    if json:
        print_json({"without_faults": without_faults, "faults": [row.as_json() for row in rows]})
    elif without_faults:
        _print_without(rows)
    else:
        _print_table(rows)
    if markdown is not None:
        _write(markdown, rows, run(without=True))
    good = proves_detection(rows) if without_faults else all(row.passed for row in rows)
    raise typer.Exit(code_of_check(good))


def _print_list(drills: Sequence[Drill]) -> None:
    out = console()
    for one in drills:
        out.print(f"{one.name}: {one.what} ({' or '.join(one.carriers)})", soft_wrap=True)


def _told_of_each(rows: Iterable[DrillRow], drills: int, missed: str) -> Iterator[DrillRow]:
    """The rows of so many drills, each told on the terminal as it comes; `missed` is the word for one that failed."""
    for number, row in enumerate(rows, 1):
        word = "ok    " if row.passed else missed
        echo(f"[{number}/{drills}] {word} {row.fault}", errors=True)
        yield row


def _refuse_together(**given: object) -> None:
    """Options that each ask for another thing."""
    from rig.errors import ConfigurationError

    names = [f"--{name.replace('_', '-')}" for name, value in given.items() if value]
    others = set(names) - {"--fault", "--random"}
    if len(others) > 1 or ("--pairs" in others and len(names) > 1):
        raise ConfigurationError(
            "these options ask for different things",
            where="rig sim drill",
            value=" ".join(names),
            remedy="Give one of them.",
        )


def acknowledge(
    operator: Annotated[str, typer.Option(metavar="NAME", help="Who acknowledges the trip.")],
    output: Annotated[
        Path, typer.Option("--runs", metavar="DIR", help="Folder of the run files.")
    ] = Path("runs"),
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
    json: Json = False,
) -> None:
    """Acknowledge a latched trip, or a run that was cut off in motion, by name, so that the next run may be started.

    Nothing starts by itself.
    """
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
    if trip.part:
        echo(f"It was cut off: {trip.message}")
        if Path(trip.part).exists():
            echo(f"Its rows are made a run by: rig recover {trip.part}")
    if not trip.standstill_verified:
        echo(
            "Standstill was NOT verified in that run: look at the rig before it is switched on.",
            errors=True,
        )


_STYLES = {True: "green", False: "red"}
"""How a sentence on all drills looks, by whether they ended as they must."""


def _print_table(rows: list[DrillRow]) -> None:
    from rig.content.grid import Grid, columns
    from rig.trial.drill.table import outcome_cells

    judged = columns("made safe", ("stands", "word"), ("verified", "word"), "outcome")
    heads = (
        *columns("fault", "must be", "detected", ("cycles", "number")),
        *judged,
        *columns(("file", "word")),
    )
    cells = [(row.fault, *outcome_cells(row, "no")) for row in rows]
    drills = painted(Grid("Fault drills", heads, cells))
    out = console()
    if not out.is_terminal:
        out.width = 180
    out.print(drills)
    failed = [row for row in rows if not row.passed]
    out.print(
        f"{len(rows) - len(failed)} of {len(rows)} drills ended as they must.",
        style=_STYLES[not failed],
    )
    for row in failed:
        out.print(
            f"{row.fault}: {row.outcome}, expected {row.expected}; "
            f"{row.evidence or 'nothing shows that the fault happened'}. {row.message}",
            soft_wrap=True,
        )


def _print_without(rows: list[DrillRow]) -> None:
    """What the drills say with every fault taken out."""
    from rig.content.grid import Grid, columns
    from rig.trial.drill.suite import proves_detection

    cells = []
    for row in rows:
        word = "claims nothing"
        if row.claims_detection:
            word = "FINDS ITS CAUSE" if row.names_cause else "fails"
        cells.append((row.fault, row.expected_cause or "nothing", row.detected, row.outcome, word))
    heads = columns(
        "fault taken out",
        "must be detected with it",
        "detected without it",
        "outcome",
        "the drill",
    )
    drills = painted(Grid("Drills without their faults", heads, cells))
    out = console()
    if not out.is_terminal:
        out.width = 180
    out.print(drills)
    claiming = [row for row in rows if row.claims_detection]
    failing = [row for row in claiming if not row.names_cause]
    proof = "the others prove nothing: they find their cause where nothing is wrong"
    if proves_detection(rows):
        proof = "what they detect is the fault, and nothing else"
    out.print(
        f"{len(failing)} of {len(claiming)} drills that claim a detection fail with their fault taken out: {proof}. "
        f"{len(rows) - len(claiming)} claim none.",
        style=_STYLES[proves_detection(rows)],
        soft_wrap=True,
    )


def _run_pairs(
    number: int, seed: int, backend: str | None, output: Path | None, json: bool
) -> bool:
    """Pairs of faults; whether all ended safe, and said so wherever anybody can be heard."""
    from collections import Counter

    from rig.trial.drill.pairs import PairRow, run_pairs

    rows: list[PairRow] = []
    for row in run_pairs(range(number), seed=seed, backend=backend, output=output):
        rows.append(row)
        if not json:
            names = " + ".join(drill.name for drill in row.pair.drills)
            echo(f"[{len(rows)}/{number}] {row.verdict}: {names}", errors=True)
    counted = Counter(row.verdict for row in rows)
    if json:
        pairs = [row.as_json() for row in rows]
        print_json({"seed": seed, "verdicts": dict(counted), "pairs": pairs})
        return all(row.passed for row in rows)
    echo(f"{number} pairs of seed {seed}, by the plant's truth and the program's word:")
    for verdict, count in counted.most_common():
        echo(f"  {count:5d} {verdict}")
    for row in rows:
        if not row.passed:
            echo(f"{row.verdict}: {row.sentence()}")
    return all(row.passed for row in rows)


def _write(path: Path, rows: list[DrillRow], without: list[DrillRow]) -> None:
    from rig.errors import RigError
    from rig.trial.drill.table import markdown

    try:
        path.write_text(markdown(rows, without), encoding="utf-8")
    except OSError as error:
        raise RigError(
            f"the table cannot be written: {error.strerror or error}", where=str(path)
        ) from error
