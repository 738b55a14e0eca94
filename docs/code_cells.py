"""Code cells of a page that is a MyST notebook, shown as code; `printed_output` shows under them what they print."""

from __future__ import annotations

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx


class CodeCell(Directive):
    """A cell as a block of Python."""

    has_content = True
    optional_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The block."""
        text = "\n".join(self.content)
        return [nodes.literal_block(text, text, language="python", classes=["cell"])]


def setup(app: Sphinx) -> dict[str, bool]:
    """Make the directive known under the name that MyST notebooks give it."""
    app.add_directive("code-cell", CodeCell)
    return {"parallel_read_safe": True}
