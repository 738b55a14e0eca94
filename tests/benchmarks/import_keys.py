"""Every recording of a folder, file by file: `rig import FILE` and its questions, and what a fit of it finds.

    HARMONIC_RIG_DATA=FOLDER python -m tests.benchmarks.import_keys

Recordings of the folder that `docs/measured.md` names, with the answers that their own documents give. Keys are those
beside Enter; seconds are of proposal and import, and of the fit. A fit has no setting but what its own warning named.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from rig.analysis.fit.run import Choices, fit_run
from rig.commands.import_proposed import said_beside, settled
from rig.errors import ConfigurationError, RunFileError
from rig.runfile.importing.accepting import accepted, is_useless
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.convert import import_tables
from rig.runfile.importing.opening import kind_of, open_tables
from rig.runfile.importing.proposal import propose


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """A recording: its files, the answers to the questions, what is said beside them, and what a fit of it is held to.

    `kind` is the fit, `quantities` its numbers with the factor to the published ones.
    """

    title: str
    files: tuple[str, ...]
    answers: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    kind: str = "motion"
    settings: tuple[tuple[str, str], ...] = ()
    quantities: tuple[tuple[str, float], ...] = ()
    published: str = "nothing"
    options: ImportOptions = field(default_factory=lambda: ImportOptions(channels=()))

    @property
    def keys(self) -> int:
        return sum(map(len, (*self.answers, *self.beside)))


def _staubli(joint: int, ratio: float, published: str, **settings: str) -> Recorded:
    """Viscous and Coulomb friction on the motor's side, brought to the joint's by the ratio."""
    return Recorded(
        title=f"Staubli TX40, joint {joint}, two files",
        files=("staubli_tx40/pos_read_data.csv", "staubli_tx40/curr_data.csv"),
        answers=(str(joint), "5000", "rad", "N m"),
        settings=tuple(settings.items()),
        quantities=(("viscous", ratio**2), ("coulomb", abs(ratio))),
        published=published,
        options=ImportOptions(channels=(), time_base="hardware"),
    )


def _tiago(joint: int, published: str, *quantities: tuple[str, float], kind: str) -> Recorded:
    files = tuple(f"tiago_arm/tiago_{name}.csv" for name in ("position", "velocity", "effort"))
    # The speed of the third joint is told by its position: nobody asks for its unit.
    answers = (str(joint), "rad", "A") if joint == 3 else (str(joint), "rad", "rad/s", "A")
    highest = (("highest_order", "500"),) if kind == "order-spectrum" else ()
    return Recorded(
        title=f"TIAGo arm, joint {joint}, three files",
        files=files,
        answers=answers,
        kind=kind,
        settings=highest,
        quantities=quantities,
        published=published,
    )


EMPS = ("position=qm:m", "force=vir:V:35.15065188")
RECORDINGS: tuple[Recorded, ...] = (
    Recorded(title="EMPS", files=("emps/DATA_EMPS.mat",), beside=EMPS,
             quantities=(("inertia", 1.0), ("viscous", 1.0), ("coulomb", 1.0), ("offset", 1.0)),
             published="95.109, 203.50, 20.394, -3.165"),
    Recorded(title="EMPS, pulses", files=("emps/DATA_EMPS_PULSES.mat",), beside=EMPS,
             quantities=(("inertia", 1.0), ("viscous", 1.0), ("coulomb", 1.0)),
             published="the same axis: 95.109, 203.50, 20.394"),
    _staubli(1, 32.0, "8.028, 7.232"),
    _staubli(2, 32.0, "5.520, 8.251", load="gravity"),
    _staubli(3, 45.0, "1.996, 6.288"),
    _staubli(4, -48.0, "1.109, 2.515"),
    _tiago(1, "0.144 ± 0.008", ("coulomb", 1.0), kind="motion"),
    _tiago(1, "none", kind="order-spectrum"),
    _tiago(2, "order 200 ± 3", kind="order-spectrum"),
    _tiago(3, "orders 200, 400: 0.024 to 0.037", kind="order-spectrum"),
    Recorded(title="friction over speed (LuGre)", files=("stribeck_pairs/test_data_1.csv",),
             answers=("rad/s", "N m"), kind="friction-curve", quantities=(("coulomb", 1.0),),
             published="14.75, 14.08 to 15.43; made with 15"),
    Recorded(title="cogging map, stopped", files=("laas_cogging/stopped_data.txt",),
             answers=("rad", "rad/s", "A", "V"), kind="revolution",
             published="orders 72, 18, 12, 144, 24, 36"),
    Recorded(title="tribometer", files=("tribometer/test_data_2.txt",), quantities=(("coulomb", 1.0),),
             published="nothing; 2.32 while it slides, by hand"),
    *(Recorded(title=f"servo and pendulum, {name}", files=(f"servo_pendulum/2026-01-15_10h29m{name}.json",),
               answers=("rad", "rad/s", "degC"), quantities=(("inertia", 1.0), ("coulomb", 1.0)),
               published="nothing of a supply voltage") for name in ("04", "21", "29")),
)  # fmt: skip
NO_JOINT = ("labview_lvm", "twincat_scope")
"""Folders whose files hold no joint: hammer and process records, counting test signals."""


def imported(one: Recorded, folder: Path, run: Path) -> tuple[int, int]:
    """Rows of the run that was made, and how many answers nobody asked for."""
    files = [folder / name for name in one.files]
    tables = open_tables(kind_of(files[0]), files)
    given, lines = iter(one.answers), iter((*one.beside, ""))
    proposal = settled(propose(tables), lambda text: next(given))
    said = said_beside(lambda text: next(lines))
    options = accepted(one.options, proposal, said)
    return import_tables(tables, options, lambda: run).rows, len([*given, *lines])


def found(one: Recorded, run: Path) -> str:
    """What the fit finds: the quantities that are published, or all amplitudes."""
    fit = fit_run(run, one.kind, Choices(settings=dict(one.settings)))
    estimates = fit.result.estimates
    names = [(name, factor) for name, factor in one.quantities if name in estimates]
    if not names:
        names = [(name, 1.0) for name in estimates if name.startswith("amplitude_")][:6]
    told = [
        f"{name.removeprefix('amplitude_')} {factor * estimates[name].value:.4g} "
        f"± {factor * estimates[name].expanded_uncertainty:.2g} {estimates[name].unit} ({estimates[name].identifiable})"
        for name, factor in names
    ]
    return "; ".join(told) or "none"


def rows(folder: Path) -> Iterator[tuple[str, ...]]:
    for one in RECORDINGS:
        with tempfile.TemporaryDirectory() as place:
            run, begun = Path(place) / "run.h5", time.perf_counter()
            made, left = imported(one, folder, run)
            imported_at = time.perf_counter()
            try:
                told = found(one, run)
            except Exception as error:  # noqa: BLE001 - a study says what stopped it
                told = f"refused: {error}"
            fitted_at = time.perf_counter()
        keys = f"{one.keys}{f' ({left} not asked)' if left else ''}"
        settings = "".join(f", {name}={value}" for name, value in one.settings)
        seconds = f"{imported_at - begun:.1f} + {fitted_at - imported_at:.1f}"
        yield one.title, keys, seconds, str(made), f"{one.kind}{settings}", told, one.published
    for name in NO_JOINT:
        for path in sorted((folder / name).iterdir()):
            if path.name in ("README.md", "LICENSE.txt"):
                continue
            begun = time.perf_counter()
            try:
                proposal = propose(open_tables(kind_of(path), [path]))
                told = (
                    "no column is recognised"
                    if is_useless(proposal)
                    else f"open: {', '.join(one.channel for one in proposal.used)}"
                )
            except (ConfigurationError, RunFileError) as error:
                told = f"refused: {error}"
            seconds = f"{time.perf_counter() - begun:.1f}"
            yield path.name, "0", seconds, "", "", told, "no joint"


def main() -> None:
    head = ("recording", "keys", "s", "rows", "fit", "found", "published")
    folder = Path(os.environ["HARMONIC_RIG_DATA"])
    for cells in chain([head, ("---",) * len(head)], rows(folder)):
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
