"""What reading packages log of a file: taken into the notes of the import instead of onto the terminal."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

LONGEST = 160
"""Characters of a message that are kept: some packages print the file."""


class _Listener(logging.Handler):
    """Keeps each message once."""

    def __init__(self, package: str) -> None:
        super().__init__(logging.WARNING)
        self._package = package
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        words = " ".join(record.getMessage().split())
        shown = words if len(words) <= LONGEST else f"{words[:LONGEST]}..."
        note = f"WARNING: {self._package} says: {shown}"
        if note not in self.said:
            self.said.append(note)


@contextmanager
def heard(package: str) -> Iterator[list[str]]:
    """The warnings of a package while the context lasts, as notes."""
    listener = _Listener(package)
    names = [
        n for n in logging.root.manager.loggerDict if n == package or n.startswith(f"{package}.")
    ]
    loggers = [logging.getLogger(name) for name in names]
    before = [(logger.handlers, logger.propagate) for logger in loggers]
    for logger in loggers:
        logger.handlers, logger.propagate = [listener], False
    try:
        yield listener.said
    finally:
        for logger, (handlers, propagate) in zip(loggers, before, strict=True):
            logger.handlers, logger.propagate = handlers, propagate
