"""What the command-line library refuses, in our words: what was given, and what is allowed."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from typing import Any, cast

from rig.content.phrase import phrase

_ALLOWED: Mapping[str, str] = {
    "int_parsing": "allowed a whole number",
    "int_from_float": "allowed a whole number",
    "float_parsing": "allowed a number",
    "finite_number": "allowed a finite number",
    "bool_parsing": "allowed yes or no",
}
"""What is allowed, by the kind of a refusal of the library that checks values."""
_BOUNDS: Mapping[str, str] = {
    "greater_than_equal": "allowed {ge:g}{unit} and more",
    "greater_than": "allowed more than {gt:g}{unit}",
    "less_than_equal": "allowed {le:g}{unit} and less",
    "less_than": "allowed less than {lt:g}{unit}",
}
"""The same of a number beyond one end of what is allowed."""
_UNITS: Mapping[str, str] = {"HZ": "Hz", "SECONDS": "s"}
"""Units of the options that name theirs in place of a value."""
_CHOICES = re.compile(r"'([^']*)' is not one of (.*)\.")
_UNKNOWN = re.compile(r"No such command '([^']*)'\.\Z")


def reword(error: BaseException) -> None:
    """Give a refusal of the library our words; any other error stays as it is."""
    refusal, message = cast("Any", error), getattr(error, "message", "")
    cause = cast("Any", error.__cause__)
    if type(cause).__name__ == "ValidationError":
        option = getattr(refusal, "param", None)
        refusal.message = "; ".join(_reason(one, option) for one in cause.errors())
    elif (unknown := _UNKNOWN.search(message)) and getattr(refusal, "ctx", None) is not None:
        # Where a name is near, the library says it.
        context = refusal.ctx
        names = context.command.list_commands(context)
        if len(names) <= 12:
            refusal.message = f"No such command {unknown[1]!r}. There are: {', '.join(names)}."
        else:
            refusal.message = f"{message} All there are: {context.command_path} help."


def _reason(found: Mapping[str, Any], option: Any) -> str:
    """One refused value of an option, and what is allowed in its place."""
    kind, given = found["type"], f"value {found['input']!s}"
    if kind in _BOUNDS:
        low, high = getattr(option, "min", None), getattr(option, "max", None)
        unit = phrase(" {}", _UNITS.get(getattr(option, "metavar", None) or "", ""))
        if low is not None and high is not None:
            return f"{given}, allowed {low:g} to {high:g}{unit}"
        return f"{given}, {_BOUNDS[kind].format(**found['ctx'], unit=unit)}"
    allowed = _ALLOWED.get(kind)
    if allowed is not None:
        return f"{given}, {allowed}"
    reason = str(found["msg"]).removeprefix("Value error, ")
    if choices := _CHOICES.fullmatch(reason):
        return f"value {choices[1]}, allowed {choices[2].replace(chr(39), '')}"
    return reason


def show(error: BaseException) -> None:
    """How the command is used, and the reason in a frame."""
    if type(error).__name__ == "NoArgsIsHelpError":
        # A page of the library's own was printed while it was made.
        sys.stdout.write(cast("Any", error).format_message().rstrip() + "\n")
        return
    from rich.panel import Panel

    from rig.commands.terminal import console
    from rig.commands.visible import Text

    out, refusal = console(errors=True), cast("Any", error)
    context = getattr(refusal, "ctx", None)
    if context is not None:
        out.print(Text(context.get_usage(), style="yellow"))
        out.print(Text(f"Try '{context.command_path} --help' for help.", style="dim"))
    message = Text(refusal.format_message())
    out.print(Panel(message, title="Error", title_align="left", border_style="red"))
