"""How many keys it takes to make a run of a recording that somebody else made: `rig import FILE`, and its questions.

    HARMONIC_RIG_DATA=FOLDER python -m tests.benchmarks.import_keys

Recordings of the folder that `docs/measured.md` names, with the answers that their own documents give. Keys are those
beside Enter; seconds are of proposal and import together.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

from rig.commands.import_proposed import said_beside, settled
from rig.runfile.importing.accepting import accepted
from rig.runfile.importing.channel_map import ImportOptions
from rig.runfile.importing.convert import import_tables
from rig.runfile.importing.looking import look_at
from rig.runfile.importing.opening import kind_of, open_tables
from rig.runfile.importing.proposal import propose
from rig.runfile.importing.reach import reach_of

RECORDINGS: tuple[tuple[str, tuple[str, ...], tuple[str, ...], tuple[str, ...]], ...] = (
    ("tribometer", ("tribometer/test_data_2.txt",), (), ()),
    ("friction over speed (LuGre)", ("stribeck_pairs/test_data_1.csv",), ("rad/s", "N m"), ()),
    (
        "TIAGo arm, joint 1, three files",
        ("tiago_arm/tiago_position.csv", "tiago_arm/tiago_velocity.csv", "tiago_arm/tiago_effort.csv"),
        ("1", "rad", "rad/s", "A"),
        (),
    ),
    (
        "Staubli TX40, joint 1, two files",
        ("staubli_tx40/pos_read_data.csv", "staubli_tx40/curr_data.csv"),
        ("1", "5000", "deg", "A"),
        (),
    ),
    ("cogging map, stopped", ("laas_cogging/stopped_data.txt",), ("rad", "rad/s", "A", "V"), ()),
    ("servo and pendulum", ("servo_pendulum/2026-01-15_10h29m04.json",), ("rad", "rad/s", "degC"), ()),
    ("EMPS", ("emps/DATA_EMPS.mat",), (), ("position=qm:m", "voltage=vir:V")),
)  # fmt: skip
"""What it is, its files, the answers to the questions, and what is said beside them."""


def main() -> None:
    folder = Path(os.environ["HARMONIC_RIG_DATA"])
    print("| recording | keys | s | good for |\n| --- | --- | --- | --- |")
    for title, names, answers, beside in RECORDINGS:
        files = [folder / name for name in names]
        begun = time.perf_counter()
        tables = open_tables(kind_of(files[0]), files)
        given, lines = iter(answers), iter((*beside, ""))
        proposal = settled(propose(tables), lambda text, given=given: next(given))
        said = said_beside(lambda text, lines=lines: next(lines))
        options = accepted(ImportOptions(channels=()), proposal, said)
        reach = reach_of(look_at(tables, options), options)
        with tempfile.TemporaryDirectory() as place:
            try:
                made = import_tables(tables, options, lambda p=place: Path(p) / "run.h5")
                told = f"{made.rows} rows; {', '.join(n for n, why in reach.items() if not why)}"
            except Exception as error:  # noqa: BLE001 - a study says what stopped it
                told = f"refused: {str(error)[:150]}"
        seconds = time.perf_counter() - begun
        left = len([*given, *lines])
        keys = sum(map(len, (*answers, *beside)))
        print(
            f"| {title} | {keys}{f' ({left} not asked)' if left else ''} | {seconds:.1f} | {told} |"
        )


if __name__ == "__main__":
    main()
