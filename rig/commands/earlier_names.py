"""Earlier names of flags and commands: scripts that use them run on, and the help shows the one name that there is now.
And how a command ends by Ctrl-C.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from typer import Abort, BadParameter
from typer.core import TyperCommand

from rig.commands.terminal import echo
from rig.runfile.file_names import unportable

_WRITTEN = frozenset({"--output", "--runs", "--junit", "--save-map"})
"""Options that name what a command may write."""
FOLDER = "--runs"
"""The folder of runs and gear cards, wherever one is read or written."""
_NAMED_BEFORE: Mapping[str, str] = {"--output": FOLDER, "-o": FOLDER, "--folder": FOLDER}
"""What the flag was called; a command that has one of these itself means something else by it, and a folder in which
runs are only looked up (`RunsFolder`) was never called so.
"""


class Command(TyperCommand):
    """A command that understands the earlier names of its flags."""

    now = ""
    """What is typed in place of a command that is itself an earlier name: it is told, and does what it did."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.help = flowing(self.help or "")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments, each earlier name taken for the present one."""
        own = {name for parameter in self.params for name in parameter.opts}
        if not any(one.name == "runs_folder" for one in self.params):
            names = {
                old: now for old, now in _NAMED_BEFORE.items() if old not in own and now in own
            }
            args = [_renamed(word, names) for word in args]
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Execute; a Ctrl-C that was raised in a run and ended it is told with the words of how the run ended."""
        if self.now:
            echo(f"`{ctx.command_path}` is `{self.now}` from now on.", errors=True)
        for parameter in self.params:
            _refuse_unportable(ctx, parameter)
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            if not getattr(error, "__notes__", ()):
                raise
            # The library would make an exit of it that says nothing.
            raise Abort from error


def flowing(words: str) -> str:
    """Help whose lines the terminal breaks, and nothing else does: one line a paragraph, one an item of a list."""
    return "\n\n".join(
        re.sub(r"\s*\n(?! *- )\s*", " ", paragraph.strip()) for paragraph in words.split("\n\n")
    )


def _refuse_unportable(ctx: Any, parameter: Any) -> None:
    """What is to be written must have a name that every system can have, and a folder a place to be made in."""
    if _WRITTEN.isdisjoint(parameter.opts):
        return
    named = ctx.params.get(parameter.name)
    for path in named if isinstance(named, (list, tuple)) else (named,):
        if isinstance(path, Path) and (why := unportable(path)):
            raise BadParameter(
                f"{path}: {why}: give another name.", ctx=ctx, param_hint=parameter.opts[0]
            )
        if not isinstance(path, Path) or FOLDER not in parameter.opts:
            continue
        if not path.exists() and not path.parent.exists():
            # One level is made when it is written to; a mistyped path is not.
            raise BadParameter(
                f"{path}: there is no folder {path.parent} to make it in. Make that, or name another.",
                ctx=ctx,
                param_hint=parameter.opts[0],
            )


def moved(now: str) -> type[Command]:
    """A command that is typed otherwise now; it is answered for one version."""
    return type("Moved", (Command,), {"now": now})


def _renamed(word: str, names: Mapping[str, str]) -> str:
    name, equals, value = word.partition("=")
    return f"{names.get(name, name)}{equals}{value}"
