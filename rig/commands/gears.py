"""`rig gear`: the cards of the gears. What is known of one, changed and confirmed by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands import gear_sets
from rig.commands.terminal import Json, console, echo, fact_table, painted, print_json
from rig.content.phrase import phrase

if TYPE_CHECKING:
    from rig.gears.card import GearCard

gear = typer.Typer(
    name="gear",
    no_args_is_help=True,
    help="Gear cards: what is known of each gear (part, mounting, lubricant, hours, load "
    "inertia, run-outs); who confirmed it.",
)

Serial = Annotated[str, typer.Argument(metavar="SERIAL", help="Serial number of the gear.")]
Folder = Annotated[
    Path,
    typer.Option("--runs", metavar="DIR", help="Folder of the run files; cards lie in its .gears."),
]
By = Annotated[
    str, typer.Option("--by", metavar="NAME", help="Who says so; kept in the history of the card.")
]
_HelpFlag = Annotated[
    bool, typer.Option("--help", "-h", help="Show this and the flags of every fact, and exit.")
]


gear.command("new")(gear_sets.new)
gear.command("check")(gear_sets.check)


@gear.command("list")
def list_(output: Folder = Path("runs"), json: Json = False) -> None:
    """List the cards of a folder of runs."""
    from rig.gears.card import list_cards
    from rig.gears.facts import stated_facts

    listed = list_cards(output)
    if json:
        content = [
            one.card.as_json() if one.card else {"path": str(one.path), "problem": one.problem}
            for one in listed
        ]
        print_json({"gears": content})
        return
    if not listed:
        console().print(
            f"No gear cards in {output}. Write one with: rig gear set SERIAL --by NAME --part csf-25-120",
            soft_wrap=True,
        )
        return
    from rig.content.grid import Grid, columns

    rows = []
    for one in listed:
        if one.card is None:
            rows.append((one.path.name, f"unreadable: {one.problem}", "", "", "", ""))
            continue
        facts = {**stated_facts(one.card.facts), "part": one.card.part_name or "-"}
        last = one.card.confirmation
        confirmed = f"{last.by}, {last.at}" if one.card.is_confirmed and last else "NO"
        cells = (str(facts.get(name, "-")) for name in ("part", "mounting", "lubricant", "hours"))
        rows.append((one.card.serial, *cells, confirmed))
    part = columns("gear", ("part", "word"), "mounting", "lubricant", ("hours", "number"))
    grid = Grid("", (*part, *columns(("confirmed", "word"))), rows)
    console().print(painted(grid))


@gear.command("show")
def show(serial: Serial, output: Folder = Path("runs"), json: Json = False) -> None:
    """Show what is known of a gear, and who changed and confirmed it."""
    card = _card(output, serial)
    _answer(card, json)


_Serial = Annotated[str, typer.Argument(metavar="SERIAL", help="Serial number of the gear.")]

_Confirm = Annotated[bool, typer.Option("--confirm", help="Confirm the card as it then is.")]


@gear.command(
    "set",
    context_settings={
        "allow_extra_args": True,
        "ignore_unknown_options": True,
        "help_option_names": [],
    },
)
def set_(
    context: typer.Context,
    serial: _Serial = "",
    by: By = "",
    output: Folder = Path("runs"),
    confirm: _Confirm = False,
    json: Json = False,
    show_help: _HelpFlag = False,
) -> None:
    """Write down facts of a gear, such as --mounting flexspline-fixed --hours 120; an empty value forgets one.

    A change of anything but the hours takes the confirmation away: confirm again with --confirm, or
    with `rig gear confirm`.
    """
    if show_help:
        echo(context.get_help())
        _print_flags()
        raise typer.Exit
    from experiments.parameters import parameter_fields
    from rig.commands.running import read_flags
    from rig.gears.card import card_for, now_text, with_confirmation
    from rig.gears.facts import GearFacts
    from rig.gears.making import write_card

    if not serial or serial.startswith("-"):
        raise typer.BadParameter("name the gear first, by its serial number", param_hint="SERIAL")
    fields = tuple(field for field in parameter_fields(GearFacts) if field.name != "serial")
    values = {
        name: _absolute(name, text)
        for name, text in read_flags("gear set", fields, context.args).items()
    }
    before = card_for(output, serial)
    card = _changed(before, {**({} if before else {"serial": serial}), **values}, by)
    if confirm:
        card = with_confirmation(card, by, now_text())
    write_card(output, card)
    _answer(card, json)


@gear.command("confirm")
def confirm_(serial: Serial, by: By, output: Folder = Path("runs"), json: Json = False) -> None:
    """Confirm by name that a gear is mounted as its card says."""
    from rig.gears.card import now_text, with_confirmation
    from rig.gears.making import write_card

    card = with_confirmation(_card(output, serial), by, now_text())
    write_card(output, card)
    _answer(card, json)


def _changed(before: GearCard | None, values: Mapping[str, object], by: str) -> GearCard:
    """The card with new values. Raises `ConfigurationError` for one that cannot be."""
    from experiments.errors import PlanError
    from rig.errors import misstated
    from rig.gears.card import now_text, with_changes

    try:
        return with_changes(before, values, by, now_text())
    except PlanError as error:
        # The fields are checked as those of a protocol are; nothing is planned here.
        raise misstated(error) from None


def _card(folder: Path, serial: str) -> GearCard:
    from rig.errors import ConfigurationError
    from rig.gears.card import card_for, list_cards

    card = card_for(folder, serial)
    if card is None:
        serials = ", ".join(one.card.serial for one in list_cards(folder) if one.card)
        raise ConfigurationError(
            "there is no card of this gear",
            where=str(folder),
            value=serial,
            limit=serials,
            remedy="Make one with `rig gear new`, or write one with `rig gear set`.",
        )
    return card


def _absolute(name: str, text: object) -> object:
    """A file by its whole path, so that the card does not depend on where it was written from."""
    if name in ("part", "acceptance") and isinstance(text, str) and text.lower().endswith(".toml"):
        return str(Path(text).resolve())
    return text


def _answer(card: GearCard, json: bool) -> None:
    """What a command on one card ends with: the card as it now is."""
    if json:
        print_json(card.as_json())
    else:
        _print(card)


def _print(card: GearCard) -> None:
    import dataclasses

    from experiments.finding import Severity
    from experiments.parameters import parameter_fields
    from rig.content.wording import named
    from rig.gears.facts import GearFacts, stated_facts
    from rig.run.gear import acceptance_checks_of_card

    out = console()
    facts = {**stated_facts(card.facts), "part": card.part_name or None}
    units = {field.name: field.unit for field in parameter_fields(GearFacts)}
    rows = []
    for field in dataclasses.fields(GearFacts):
        value = facts.get(field.name)
        text = "not known" if value is None else str(value)
        if isinstance(value, float):
            text = f"{value:g} {units[field.name]}"
        rows.append((named(field.name)[0], text))
    out.print(fact_table(rows, f"Gear {card.serial}"))
    for event in card.history:
        names = ", ".join(named(name)[0] for name in event.values)
        out.print(f"{event.at}  {event.what} by {event.by}{phrase(': {}', names)}")
    last = card.confirmation
    if card.is_confirmed and last is not None:
        out.print(f"confirmed by {last.by}, {last.at}", style="green")
    else:
        out.print(f"warning: {card.warning}", style="yellow", soft_wrap=True)
    for check in acceptance_checks_of_card(card):
        if check.severity is not Severity.PASSED:
            out.print(f"warning: {check.found}", style="yellow", soft_wrap=True)


def _print_flags() -> None:
    from experiments.parameters import parameter_fields
    from rig.content.grid import Grid, columns
    from rig.gears.facts import CHOICES, GearFacts

    rows = [
        (one.flag, one.unit, ", ".join(CHOICES.get(one.name, ())) or one.limit, one.help)
        for one in parameter_fields(GearFacts)
        if one.name != "serial"
    ]
    heads = columns(("flag", "unit"), ("unit", "unit"), "allowed", "what")
    console().print(painted(Grid("Facts of a gear", heads, rows)))
