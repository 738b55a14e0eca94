"""`rig gear new` and `rig gear check`: a parameter set from a part number, and what contradicts itself in one."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.terminal import Json, console, echo, painted, print_json
from rig.content.phrase import phrase, quoted

if TYPE_CHECKING:
    from model.catalogue.contradictions import Contradiction
    from model.gear import HarmonicDrive, Value
    from rig.gears.making import NewGear

Stated = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help='A value from the nameplate or the papers, with its unit: --set ratings.rated_torque="137 N m".',
    ),
]
_Product = Annotated[
    str,
    typer.Argument(
        metavar="PRODUCT", help="Part number with its unit type, such as SHG-32-100-2UH."
    ),
]

_Serial = Annotated[
    str, typer.Option("--serial", metavar="SERIAL", help="Serial number of the gear.")
]

_By = Annotated[
    str, typer.Option("--by", metavar="NAME", help="Who says so; kept in set and card.")
]

_Mounting = Annotated[
    str,
    typer.Option("--mounting", metavar="WORD", help="circular-spline-fixed or flexspline-fixed."),
]

_Acceptance = Annotated[
    str,
    typer.Option(
        "--acceptance",
        metavar="FILE",
        help="What it must show: a shipped acceptance file, or a TOML file.",
    ),
]

_DespiteRuns = Annotated[
    bool,
    typer.Option("--despite-runs", help="Though runs of this serial number name another part."),
]

_Output = Annotated[
    Path,
    typer.Option("--runs", metavar="DIR", help="Folder of the run files; cards lie in its .gears."),
]


def new(
    product: _Product,
    serial: _Serial,
    by: _By,
    set_: Stated = None,
    mounting: _Mounting = "",
    acceptance: _Acceptance = "",
    despite_runs: _DespiteRuns = False,
    output: _Output = Path("runs"),
    json: Json = False,
) -> None:
    """Make the parameter set and the card of a gear from its part number.

    Values come from makers' tables where these have the product; the rest is scaled and marked as assumed.
    On a terminal the nameplate's values are asked one by one, and Enter keeps what is there; a script states them
    with --set, or leaves them marked.
    """
    from model.catalogue.table import read_product
    from model.gear_file import SECTIONS
    from rig.errors import ConfigurationError
    from rig.gears.card import now_text
    from rig.gears.making import made_gear, write_new_gear
    from rig.gears.stating import declared, read_stated, remark_of

    if not by.strip():
        raise ConfigurationError(
            "nobody is named who would make the gear", where="--by", remedy="Give your name."
        )
    part, at = read_product(product), now_text()
    known = declared(SECTIONS)
    stated = read_stated(set_ or [], known)
    for text in set_ or []:
        path, _, value = (part.strip() for part in text.partition("="))
        if not json and (remark := remark_of(path, value, known[path])):
            echo(remark)
    gear = made_gear(part, stated, by, at)
    can_ask = not json and sys.stdin.isatty()
    if not despite_runs:
        _refuse_another_part(serial, gear.name, output, can_ask=can_ask)
    if can_ask:
        stated |= asked(_questions(gear, stated), known)
        gear = made_gear(part, stated, by, at)
    path = str(Path(acceptance).resolve()) if acceptance.lower().endswith(".toml") else acceptance
    facts = {"serial": serial, "mounting": mounting, "acceptance": path}
    _tell_made(write_new_gear(output, gear, facts, by, at), gear, json=json)


def _tell_made(made: NewGear, gear: HarmonicDrive, *, json: bool) -> None:
    """What was made, what is open, and what contradicts itself, for a person or a program."""
    from model.catalogue.contradictions import contradictions, not_compared

    found, aside = contradictions(gear), not_compared(gear)
    if json:
        print_json(
            {
                "serial": made.card.serial,
                "part": gear.name,
                "file": str(made.path),
                "assumed": list(made.open_questions),
                "contradictions": [c.as_json() for c in found],
                "not_compared": aside,
            }
        )
        return
    _print_made(made)
    print_contradictions(found, aside)


def _refuse_another_part(serial: str, part: str, folder: Path, *, can_ask: bool) -> None:
    """Runs of this serial number that name another part are named, and the word asked for: it may be mistyped.

    Raises `ConfigurationError` where nobody can be asked, or the answer is not `yes`.
    """
    from rig.commands.prompting import CONSENT
    from rig.errors import ConfigurationError
    from rig.library.index import LibraryIndex

    runs = LibraryIndex(folder, nested=True).search(gear=serial) if folder.is_dir() else []
    others = [run for run in runs if run.gear and run.gear != part]
    if not others:
        return
    named = ", ".join(f"{run.path.name} ({run.gear})" for run in others[:3])
    more = phrase(" and {} more", len(others[3:]))
    if can_ask:
        echo(f"Runs of {serial} name another part than {part}: {named}{more}.")
        if input(f"Is {serial} a {part} all the same? Type {CONSENT}: ").strip().lower() == CONSENT:
            return
    raise ConfigurationError(
        f"has runs of another part than {part}",
        where=f"gear {serial}",
        value=f"{named}{more}",
        remedy="Look at the serial number; where it is right: --despite-runs.",
    )


def check(
    gear: Annotated[
        str,
        typer.Argument(
            metavar="SERIAL|FILE", help="Serial number of a card, or a parameter set (TOML)."
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--runs", metavar="DIR", help="Folder of the run files; cards lie in its .gears."
        ),
    ] = Path("runs"),
    json: Json = False,
) -> None:
    """Find what contradicts itself in a gear's parameter set, or contradicts the table of its series; 2 if anything."""
    from model.catalogue.contradictions import contradictions, not_compared
    from rig import exits

    part = _named(gear, output)
    found, aside = contradictions(part), not_compared(part)
    if json:
        print_json(
            {
                "part": part.name,
                "contradictions": [c.as_json() for c in found],
                "not_compared": aside,
            }
        )
    else:
        print_contradictions(found, aside, part.name)
    if found:
        raise typer.Exit(exits.USAGE)


def _named(text: str, folder: Path) -> HarmonicDrive:
    """The parameter set of a file, or of a card by its serial number."""
    from model.gear_file import load_gear, shipped_gear
    from rig.errors import ConfigurationError
    from rig.gears.card import card_for, gear_of

    if text.lower().endswith(".toml"):
        return load_gear(text)
    card = card_for(folder, text)
    if card is None or not card.facts.part:
        raise ConfigurationError(
            "there is no card of this gear" if card is None else "its card names no part",
            where=str(folder),
            value=text,
            remedy="Make one with `rig gear new`, or name a TOML file.",
        )
    return gear_of(card.facts, shipped_gear())


def _questions(gear: HarmonicDrive, stated: Mapping[str, float]) -> Iterable[Value]:
    from model.catalogue.proportions import NAMEPLATE

    return [gear.value(path) for path in NAMEPLATE if path not in stated]


def asked(
    values: Iterable[Value],
    known: Mapping[str, Mapping[str, Any]],
    ask: Callable[[str], str] = input,
) -> dict[str, float]:
    """What somebody at the terminal answers: one question for each value; Enter or the end of input keeps it."""
    from model.errors import ParameterError
    from model.quantities import readable
    from rig.content.wording import visible
    from rig.gears.stating import remark_of, value_of

    answers: dict[str, float] = {}
    for value in values:
        (text,), unit = readable([value.value], value.unit)
        question = visible(f"{value.description} [{text} {unit}, {value.origin.provenance}]: ")
        while True:
            try:
                answer = ask(question).strip()
            except EOFError:
                return answers
            if not answer:
                break
            try:
                answers[value.path] = value_of(value.path, answer, known[value.path])
                if remark := remark_of(value.path, answer, known[value.path]):
                    echo(remark)
                break
            except ParameterError as error:
                echo(str(error))
    return answers


def print_contradictions(found: Iterable[Contradiction], not_compared: str, name: str = "") -> None:
    """What was found, or that nothing was."""
    from rig.content.grid import Grid, columns

    out, listed = console(), list(found)
    if listed:
        rows = [(one.name, one.where, one.value, one.expected, one.remedy) for one in listed]
        heads = columns("contradiction", "where", "value", "expected", "what to do")
        out.print(painted(Grid("", heads, rows)))
    else:
        out.print(f"{name or 'the set'}: nothing contradicts itself", style="green")
    if not_compared:
        out.print(not_compared, style="yellow", soft_wrap=True)


def _print_made(made: NewGear) -> None:
    out = console()
    gear = made.gear
    out.print(f"Gear {made.card.serial}, {gear.name}: {made.path}", soft_wrap=True)
    if made.open_questions:
        out.print(
            "Nobody has looked these up yet; they are assumed:", style="yellow", soft_wrap=True
        )
        for path in made.open_questions:
            out.print(f"  {path}: {gear.value(path).description}", soft_wrap=True)
    serial, facts = quoted(made.card.serial), made.card.facts
    missing = [
        words
        for words, is_said in (
            ("--mounting circular-spline-fixed", facts.mounting),
            ("--acceptance FILE", facts.acceptance),
        )
        if not is_said
    ]
    begin = "Next:"
    if missing:
        out.print(
            f"Next: rig gear set {quoted(serial)} --by NAME {' '.join(missing)}", soft_wrap=True
        )
        begin = "then"
    out.print(
        f"{begin} look at the gear, and rig gear confirm {quoted(serial)} --by NAME", soft_wrap=True
    )
