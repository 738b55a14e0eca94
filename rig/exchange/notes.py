"""What stands beside an exported file: what each number means in the target, what it can't hold, how far off it is."""

from __future__ import annotations

from dataclasses import dataclass

from rig.content.grid import Grid, columns, number_columns
from rig.content.wording import aligned, number
from rig.exchange.joint import Form, FormName, Joint, in_words

TITLES = {
    "linear": "constant and linear",
    "polynomial": "constant and polynomial of third degree",
    "lugre": "LuGre and polynomial of third degree",
}
"""What the forms are called."""
NEVER = (
    "the kinematic error: the output follows its input exactly",
    "elasticity and its damping: the joint is stiff",
    "friction that depends on the load, on temperature, or on where the output stands",
    "the doubt of each number: it stands in the JSON form and in the samples",
)
"""What neither MJCF nor URDF holds of a gear."""


@dataclass(frozen=True)
class Meaning:
    """One number of an exported file: where it stands, its value with unit, and what the target makes of it."""

    place: str
    value: str
    meaning: str


@dataclass(frozen=True, kw_only=True)
class Notes:
    """All that is said of an exported file. `form` is the law of friction in it, None where the equations are."""

    title: str
    target: str
    joint: Joint
    meanings: tuple[Meaning, ...]
    form: FormName | None
    forms: tuple[Form, ...]
    cannot: tuple[str, ...]
    example: tuple[str, ...]
    remarks: tuple[str, ...] = ()


def error_grid(notes: Notes) -> Grid:
    """The forms beside each other: relative error against equation 20 over the speeds."""
    low, high = (in_words(notes.joint, float(notes.joint.speeds[end])) for end in (0, -1))
    rows = [
        (
            f"{TITLES[form.name]}{' (in the file)' if form.name == notes.form else ''}",
            number(100.0 * form.rms, 2),
            number(100.0 * form.worst, 2),
            in_words(notes.joint, form.worst_at),
        )
        for form in notes.forms
    ]
    heads = (*columns("friction as"), *number_columns("r.m.s. [%]", "worst [%]"), *columns("at"))
    return Grid("Friction against equation 20", heads, rows, f"from {low} to {high}")


def meaning_grid(notes: Notes) -> Grid:
    """Every number of the file."""
    rows = [(one.place, one.value, one.meaning) for one in notes.meanings]
    return Grid(
        f"In {notes.target}",
        columns(("number", "unit"), ("value", "unit"), ("means", "sentence")),
        rows,
    )


def sentences(notes: Notes) -> tuple[str, ...]:
    """What the target can't hold, and what is to be said of the gear."""
    whole = () if notes.forms else ("friction: equation 20 itself, with no error over speed",)
    return (*whole, *(f"not held: {one}" for one in notes.cannot), *notes.remarks)


def notes_text(notes: Notes) -> str:
    """The notes as a text file."""
    grids = (meaning_grid(notes), *([error_grid(notes)] if notes.forms else []))
    said = "\n".join(sentences(notes))
    example = "\n".join(["Example", *notes.example])
    return "\n\n".join([notes.title, *map(grid_text, grids), said, example]) + "\n"


def grid_text(grid: Grid) -> str:
    """A table as text, its columns under each other."""
    rows = aligned([grid.headings, *grid.rows])
    return "\n".join([grid.title, *rows, *([grid.note] if grid.note else [])])
