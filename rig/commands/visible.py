"""Texts on a terminal: whatever stands in a file, it is shown and never obeyed.

Operators' names, notes, events, serial numbers, paths and messages come from files that anybody may
have written. Markup of rich is nothing here, an escape sequence, a carriage return or a turn of the
writing direction is shown by its number. Every text of a command goes through one of these.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import rich.text
from rich.console import Console, ConsoleOptions, RenderableType

from rig.content.wording import visible

if TYPE_CHECKING:
    from rich.progress import Task, TextColumn


_HANGING = 2
"""Letters by which a line that goes on is set in."""


class Text(rich.text.Text):
    """A text with a style, as rich has it, in which nothing is left that a terminal would obey."""

    def __init__(self, text: str = "", *arguments: Any, **look: Any) -> None:
        super().__init__(visible(text), *arguments, **look)

    def append(self, text: rich.text.Text | str, style: Any = None) -> Text:
        """Add a text, as rich does."""
        super().append(visible(text) if isinstance(text, str) else text, style)
        return self


class VisibleConsole(Console):
    """A terminal that shows what others would obey, and takes nothing in a text for markup or a picture."""

    def __init__(self, **look: Any) -> None:
        super().__init__(markup=False, emoji=False, **look)

    def print(self, *objects: Any, soft_wrap: bool | None = None, **look: Any) -> None:
        """As rich prints. A long line (`soft_wrap`) stays one line where a program reads it; on a terminal it goes on
        below itself, broken between words alone: a path stays whole.
        """
        if not soft_wrap or not self.is_terminal or len(objects) != 1:
            super().print(*objects, soft_wrap=soft_wrap, **look)
            return
        (given,) = objects
        text = given if isinstance(given, rich.text.Text) else Text(str(given))
        indent = len(text.plain) - len(text.plain.lstrip(" "))
        width = max(self.width - indent - _HANGING, 20)
        text = text[indent:]
        for number, line in enumerate(text.divide(breaks(text.plain, width))):
            line.rstrip()
            line.pad_left(indent + _HANGING * (number > 0))
            super().print(line, no_wrap=True, overflow="ignore", crop=False, **look)

    def render_str(self, text: str, **look: Any) -> rich.text.Text:
        """A plain text: cells of tables, titles, and what is printed as it is."""
        return super().render_str(visible(text), **look)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Any:
        """A text that was made elsewhere keeps its styles and loses what would steer the terminal."""
        if isinstance(renderable, rich.text.Text) and visible(renderable.plain) != renderable.plain:
            renderable = Text(renderable.plain, style=renderable.style)
        return super().render(renderable, options)


def breaks(text: str, width: int) -> list[int]:
    """Where a text is broken into lines of this width: between words, of which one that is longer stays whole."""
    places, start = [], 0
    for word in re.finditer(r"\S+", text):
        if word.end() - start > width and word.start() > start:
            places.append(word.start())
            start = word.start()
    return places


def plain_column(template: str) -> TextColumn:
    """A text beside a bar of progress. That of rich reads markup in it, whatever its console is told."""
    from rich.progress import TextColumn

    class PlainColumn(TextColumn):
        def render(self, task: Task) -> rich.text.Text:
            return Text(self.text_format.format(task=task), style=self.style, justify=self.justify)

    return PlainColumn(template)
