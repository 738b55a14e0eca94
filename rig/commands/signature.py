"""The signature of a command whose options are made from a table: they stand in the place of its parameter `said`."""

from __future__ import annotations

import functools
import inspect
import typing
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

Command = TypeVar("Command", bound=Callable[..., None])
SAID = "said"
"""The parameter of a command in whose place the options stand."""


def with_options(
    options: Iterable[inspect.Parameter], gathered: Callable[[dict[str, Any]], object]
) -> Callable[[Command], Command]:
    """Give a command these options in the place of its parameter `said`.

    `gathered` takes them out of all that was typed, and makes what the command is called with.
    """
    made = list(options)

    def decorated(command: Command) -> Command:
        own = inspect.signature(command)
        hints = typing.get_type_hints(command, include_extras=True)
        rows: list[inspect.Parameter] = []
        for parameter in own.parameters.values():
            if parameter.name == SAID:
                rows += made
            else:
                rows.append(parameter.replace(annotation=hints[parameter.name]))
        rows = [row.replace(kind=inspect.Parameter.KEYWORD_ONLY) for row in rows]

        @functools.wraps(command)
        def called(**given: Any) -> None:
            said = gathered(given)
            command(said=said, **given)

        called.__dict__["__signature__"] = own.replace(parameters=rows)
        called.__annotations__ = {row.name: row.annotation for row in rows}
        return typing.cast("Command", called)

    return decorated
