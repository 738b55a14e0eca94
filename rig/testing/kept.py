"""One thing that is kept, or not."""

from __future__ import annotations


def keep(is_kept: object, otherwise: str) -> None:
    """Raise `AssertionError` with a sentence unless something is kept; in an optimised Python too."""
    if not is_kept:
        raise AssertionError(otherwise)
