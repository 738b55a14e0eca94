"""Texts on a terminal: whatever stands in a file, it is shown and never obeyed.

Operators' names, notes, events, serial numbers, paths and messages come from files that anybody may
have written. Markup of rich is nothing here, an escape sequence, a carriage return or a turn of the
writing direction is shown by its number. Every text of a command goes through one of these.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import rich.text
from rich.console import Console, ConsoleOptions, RenderableType

from rig.content.wording import visible

if TYPE_CHECKING:
    from rich.progress import Task, TextColumn


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

    def render_str(self, text: str, **look: Any) -> rich.text.Text:
        """A plain text: cells of tables, titles, and what is printed as it is."""
        return super().render_str(visible(text), **look)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Any:
        """A text that was made elsewhere keeps its styles and loses what would steer the terminal."""
        if isinstance(renderable, rich.text.Text) and visible(renderable.plain) != renderable.plain:
            renderable = Text(renderable.plain, style=renderable.style)
        return super().render(renderable, options)


def plain_column(template: str) -> TextColumn:
    """A text beside a bar of progress. That of rich reads markup in it, whatever its console is told."""
    from rich.progress import TextColumn

    class PlainColumn(TextColumn):
        def render(self, task: Task) -> rich.text.Text:
            return Text(self.text_format.format(task=task), style=self.style, justify=self.justify)

    return PlainColumn(template)
