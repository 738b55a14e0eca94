"""The first page of help, which is short, and `rig help`, which has every command."""

from __future__ import annotations

import re
from collections.abc import Mapping
from textwrap import wrap
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from rig.commands.terminal import echo
from rig.errors import nearest

_SHORT = 20
"""Letters that a line has at least before it ends at a stop, a comma or a bracket."""
_END = re.compile(rf"^(.{{{_SHORT},}}?)(?:[:;,.](?= |$)| \().*$")


def first_page(command: TyperGroup, usage: str, day: Mapping[str, str]) -> str:
    """What is typed on an ordinary day, a line each (`day`: a command's name and its words), and the way on."""
    about = "\n".join(wrap(re.sub(r"\[/?bold\]", "", command.help or ""), 78))
    codes = "\n".join(wrap(command.epilog or "", 78))
    told = "\n".join(f"  {name:<13}{_line(words)}" for name, words in day.items())
    more = "  More: rig help. Of one: rig help COMMAND. Version: rig --version."
    return f"{usage}\n\n{about}\n\n{told}\n\n{more}\n\n{codes}"


def _line(words: str) -> str:
    """The beginning of a command's own help: one line of it."""
    whole = " ".join(words.partition("\n\n")[0].split())
    found = _END.match(whole)
    return f"{found[1] if found else whole.removesuffix('.')}."


def help_(
    context: typer.Context,
    command: Annotated[
        list[str] | None, typer.Argument(help="Of which command; of all where none is named.")
    ] = None,
) -> None:
    """Every command under its heading, or the options of one command."""
    of: Any = context.parent
    group: Any = of.command
    if not command:
        TyperGroup.format_help(group, of, of.make_formatter())
        return
    for name in command:
        found = group.get_command(of, name) if hasattr(group, "get_command") else None
        if found is None:
            listed = group.list_commands(of) if hasattr(group, "list_commands") else []
            names = [one for one in listed if not group.get_command(of, one).hidden]
            raise typer.BadParameter(f"no such command: {name}. {nearest(name, names)}")
        of, group = typer.Context(found, info_name=name, parent=of), found
    if text := group.get_help(of):
        echo(text)
