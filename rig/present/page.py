"""The web page: one self-contained HTML file that a laboratory can send out.

Nothing is loaded from elsewhere; everything that comes from files is escaped.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.content.grid import capital, tone_of
from rig.content.page import Page
from rig.content.wording import printable, unbroken
from rig.errors import ConfigurationError, RigError

if TYPE_CHECKING:
    import jinja2

TEMPLATE, STYLE = "page.html", "page.css"
SUFFIXES = (".html", ".htm", ".pdf")


def write_page(page: Page, path: str | Path) -> Path:
    """Write a report as HTML or, by its suffix, as PDF. Raises `RigError` for a file that cannot be written."""
    path = Path(path)
    data = rendered(page, path)
    try:
        # One folder is made, as a new month needs it: two would be a path mistyped.
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
    except OSError as error:
        raise RigError(
            "the report cannot be written",
            where=str(path),
            value=error.strerror or str(error),
            remedy="Choose another --output.",
        ) from None
    return path


def suffix_of(path: Path) -> str:
    """The suffix of the file of a report. Raises `ConfigurationError` for one that no report has."""
    if path.suffix.lower() not in SUFFIXES:
        raise ConfigurationError("a report is .html or .pdf", where=str(path))
    return path.suffix


def rendered(page: Page, path: Path) -> bytes:
    """A report as PDF or HTML, by the suffix of its path. Raises `RigError`."""
    if suffix_of(path).lower() != ".pdf":
        return render_page(page).encode("utf-8")
    from rig.present.paper import render_pdf

    return render_pdf(page)


def render_page(page: Page) -> str:
    """The HTML of a report."""
    from markupsafe import Markup

    jinja = environment()
    style = Markup(jinja.get_template(STYLE).render())
    return jinja.get_template(TEMPLATE).render(style=style, page=page)


def environment() -> jinja2.Environment:
    """The templates of this folder, everything that they show escaped."""
    import jinja2
    from markupsafe import Markup

    made = jinja2.Environment(
        loader=jinja2.PackageLoader("rig", "present"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_finalize,
    )

    def escaped(text: str) -> str:
        return str(Markup.escape(printable(text)))

    made.filters |= {
        "css": lambda text: Markup(css_text(text)),
        "headed": lambda text: capital(unbroken(text)),
        "tone": lambda text: tone_of(text) or "",
        "symbols": lambda text: Markup(_symbols(escaped(text))),
        "linked": lambda text: Markup(_linked(escaped(text))),
    }
    return made


def css_text(text: str) -> str:
    """A text as a string of a style sheet, letter for letter: whatever is no plain letter goes by its number."""
    plain = "".join(
        c if c.isascii() and (c.isalnum() or c in " ,.-_") else f"\\{ord(c):x} "
        for c in printable(text)
    )
    return f'"{plain}"'


_SYMBOL = re.compile(r"\b((?:[^\W\d_]/)?[^\W\d_])_([A-Za-z0-9]{1,4})\b")


def _symbols(escaped: str) -> str:
    """Symbols of the paper as they are printed: what follows the underscore of a single letter
    stands below the line.
    """
    return _SYMBOL.sub(r"<i>\1</i><sub>\2</sub>", escaped)


def _linked(escaped: str) -> str:
    """Numbers of figures as links to them; a text that names none stays what it is."""
    if not escaped.startswith("Figure "):
        return escaped
    return re.sub(r"(Figure )?(\d+)", r'<a href="#figure-\2">\1\2</a>', escaped)


def _finalize(value: Any) -> Any:
    """Texts without control characters; markup of ours as it is."""
    return printable(value) if type(value) is str else value
