"""The wording rule of errors, and the one error root of this floor.

A message says what, where, value, limit, and what to do next. The floors above reuse the wording for their own roots.
"""

from __future__ import annotations

_TRACEBACK = "Traceback (most recent call last)"


def without_traceback(text: str) -> str:
    """A text in which somebody else has put the traceback of an error: what stands before it, and its last line."""
    before, found, traced = text.partition(_TRACEBACK)
    if not found:
        return text
    last = traced.strip().rpartition("\n")[2].strip()
    return without_traceback(f"{before.strip()} {last}".strip())


def path_of(where: str, name: str) -> str:
    """Where a value stands: `geometry.pair_load`; its name alone where nothing is above it."""
    return f"{where}.{name}" if where else name


class WordedError(Exception):
    """An error in the project's wording.

    `what` is the sentence; `where` the path of the value (`geometry.radial_deformation`); `value` what was found;
    `limit` what is allowed; `remedy` what to do next. All of them stay readable as attributes.
    """

    def __init__(
        self, what: str, *, where: str = "", value: object = None, limit: str = "", remedy: str = ""
    ) -> None:
        if isinstance(value, str):
            value = without_traceback(value)
        self.what, self.where, self.value, self.limit, self.remedy = (
            without_traceback(what),
            where,
            value,
            limit,
            remedy,
        )
        text = f"{where}: {self.what}" if where else self.what
        if value is not None:
            text += f"; value {value}"
        if limit:
            text += f", allowed {limit}"
        if remedy:
            text += f". {remedy}"
        super().__init__(text)


class ModelError(WordedError, ValueError):
    """Something that the physics or the identification cannot accept or cannot do."""


class ParameterError(ModelError):
    """A parameter set with a wrong, missing or impossible value."""


class IdentificationError(ModelError):
    """Data that cannot carry the estimate that was asked of them."""
