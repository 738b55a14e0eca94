"""`rig export-model`: an identified gear for other people's tools."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.terminal import Json, console, echo, painted, print_json
from rig.content.phrase import phrase

if TYPE_CHECKING:
    from rig.exchange.exporting import Export


class _TargetWord(str, Enum):  # noqa: UP042  StrEnum has another str() that shows in the help
    """For which tool."""

    json = "json"
    mjcf = "mjcf"
    urdf = "urdf"


class _SideWord(str, Enum):  # noqa: UP042
    """From which side of the gear."""

    motor = "motor"
    joint = "joint"


class FormWord(str, Enum):  # noqa: UP042
    """By which law MJCF has friction."""

    lugre = "lugre"
    polynomial = "polynomial"
    linear = "linear"


_Source = Annotated[
    str,
    typer.Argument(
        metavar="GEAR|RUN",
        help="Serial number of a gear with analysed runs, an analysed run (file, number), a parameter set (TOML).",
    ),
]

_Side = Annotated[
    _SideWord, typer.Option("--side", help="Friction and inertia at the motor or at the joint.")
]

_Form = Annotated[
    FormWord,
    typer.Option(
        "--form", help="MJCF's law of friction; linear is all that MuJoCo before 4 reads."
    ),
]

_Samples = Annotated[
    int,
    typer.Option(
        "--samples", metavar="N", help="Draw N gears from what is known, as a table beside."
    ),
]

_Check = Annotated[
    bool,
    typer.Option(
        "--check", help="Simulate it in the target, and print the difference (extra: export)."
    ),
]

_Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        help="What to write; by default the gear's name with .json, .xml or .urdf.",
    ),
]


def export_model(
    source: _Source,
    to: Annotated[_TargetWord, typer.Option("--to", help="The tool.")],
    side: _Side = _SideWord.joint,
    form: _Form = FormWord.lugre,
    samples: _Samples = 0,
    seed: Annotated[int, typer.Option("--seed", help="Of the draws.")] = 0,
    check: _Check = False,
    output: _Output = None,
    folder: Annotated[Path, typer.Option("--runs", metavar="DIR", help="Folder of runs.")] = Path(
        "runs"
    ),
    json: Json = False,
) -> None:
    """Write an identified gear for a simulator: JSON with covariance, MuJoCo's MJCF, or URDF.

    Beside the file stands what each number means in that target, what the target can't hold, and how far
    its friction is off over speed. There is no FMI and no Modelica in this version.
    """
    from rig.exchange.exporting import default_name, exported, written
    from rig.exchange.identified import identified_gear

    gear = identified_gear(source, folder)
    place = output or Path(default_name(gear, to.value))
    done = exported(
        gear,
        to.value,
        side=side.value,
        form=form.value,
        draws=samples,
        seed=seed,
        is_checked=check,
        file=place.name,
    )
    files = written(done, place)
    if json:
        print_json({"files": [str(path) for path in files], **done.as_json()})
        return
    _show(done)
    for path in files:
        echo(f"written  {path}")


def _show(done: Export) -> None:
    """What the numbers mean, how far off they are, what the target made of them, what it can't hold."""
    from rig.exchange.check import check_grid
    from rig.exchange.notes import error_grid, meaning_grid, sentences

    out, notes = console(), done.notes
    echo(f"{phrase('{}  ', done.identified.mark)}{notes.title}")
    out.print(painted(meaning_grid(notes)))
    if notes.forms:
        out.print(painted(error_grid(notes)))
    if done.checked:
        out.print(painted(check_grid(done.checked, notes.target)))
    for sentence in sentences(notes):
        out.print(sentence, soft_wrap=True)
    echo("\n".join(["Example", *notes.example]))
