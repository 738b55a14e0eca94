"""Parameter sets of motors, made from the nameplate and looked over: `rig config new --motor`, `rig config check`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.earlier_names import moved
from rig.commands.gear_sets import Json, asked, print_contradictions
from rig.commands.terminal import console, print_json

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from model.gear import Value
    from model.motor import ServoMotor

motor = typer.Typer(
    name="motor",
    no_args_is_help=True,
    hidden=True,
    help="Parameter sets of motors: made from the nameplate, and looked over for contradictions.",
)


@motor.command("new", cls=moved("rig config new FILE --motor NAME"))
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Type of the motor.")],
    file: Annotated[
        Path, typer.Option("--file", metavar="FILE", help="The parameter set to write (TOML).")
    ],
    by: Annotated[str, typer.Option("--by", metavar="NAME", help="Who read the nameplate.")],
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help='A value of the plate with its unit: --set rated_torque="0.637 N m"; that one is needed.',
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Make the parameter set of a motor from its nameplate; what is not stated is scaled and marked as assumed."""
    new_motor(name, file, by, set_, json=json)


def new_motor(name: str, file: Path, by: str, set_: list[str] | None, *, json: bool) -> None:
    """Write the parameter set of a motor of this type, of what its nameplate states and who read it."""
    from model.catalogue.motors import motor_contradictions, motor_named, open_questions
    from model.gear import Origin
    from model.motor import ServoMotor, save_motor
    from rig.errors import ConfigurationError
    from rig.gears.card import now_text
    from rig.gears.stating import declared, read_stated

    if not by.strip():
        raise ConfigurationError(
            "nobody is named who would make the motor", where="--by", remedy="Give your name."
        )
    if file.exists():
        raise ConfigurationError(
            "is there already", where=str(file), remedy="Name another file, or take it away."
        )
    known = declared({"": ServoMotor})
    origin = Origin("catalogue", f"nameplate or data sheet, read by {by.strip()}, {now_text()}")
    stated = read_stated(set_ or [], known)
    made = motor_named(name, stated, origin)
    if not json and sys.stdin.isatty():
        stated |= asked(_questions(made, stated, known), known)
        made = motor_named(name, stated, origin)
    save_motor(made, file)
    found = motor_contradictions(made)
    if json:
        print_json(
            {
                "motor": made.name,
                "file": str(file),
                "assumed": list(open_questions(made)),
                "contradictions": [c.as_json() for c in found],
            }
        )
        return
    console().print(f"Motor {made.name}: {file}", soft_wrap=True)
    if names := ", ".join(open_questions(made)):
        console().print(f"Assumed, not looked up: {names}", style="yellow", soft_wrap=True)
    print_contradictions(found, "", made.name)


@motor.command("check", cls=moved("rig config check FILE"))
def check(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE", help="A parameter set (TOML), or the name of a shipped one."
        ),
    ],
    json: Json = False,
) -> None:
    """Find what contradicts itself in a motor's parameter set; exit code 2 if anything does."""
    check_motor(file, json=json)


def is_motor(file: Path) -> bool:
    """Whether this is the parameter set of a motor, or a name as shipped ones have, and no description of a rig."""
    import tomllib

    from model.motor import FORMAT

    if not file.is_file():
        return not file.suffix
    try:
        return tomllib.loads(file.read_text(encoding="utf-8")).get("format") == FORMAT
    except (OSError, ValueError):
        return False


def check_motor(file: str, *, json: bool) -> None:
    """Print what contradicts itself in a motor's parameter set; exit code 2 if anything does."""
    from model.catalogue.motors import motor_contradictions
    from model.motor import load_motor, shipped_motor
    from rig import exits

    part = load_motor(file) if file.lower().endswith(".toml") else shipped_motor(file)
    found = motor_contradictions(part)
    if json:
        print_json({"motor": part.name, "contradictions": [c.as_json() for c in found]})
    else:
        print_contradictions(found, "", part.name)
    if found:
        raise typer.Exit(exits.USAGE)


def _questions(
    made: ServoMotor, stated: Mapping[str, float], known: Mapping[str, Mapping[str, Any]]
) -> list[Value]:
    from model.catalogue.motors import NAMEPLATE
    from model.gear import Value

    return [
        Value(
            name,
            known[name]["symbol"],
            getattr(made, name),
            known[name]["unit"],
            known[name]["description"],
            made.origins[name],
        )
        for name in NAMEPLATE
        if name not in stated
    ]
