"""A source of single samples that lie in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from model.identify.checks import Array
from model.identify.orders.samples import CHUNK, Piece, Source


def in_memory(stretches: Iterable[tuple[int, Array, Array]]) -> Source:
    """A source of (direction, angle, value) per stretch."""
    parts = list(stretches)

    def pieces() -> Iterator[Piece]:
        for number, (direction, angle, value) in enumerate(parts):
            for at in range(0, len(angle), CHUNK):
                rows = slice(at, at + CHUNK)
                yield Piece.of(number, direction, angle[rows], value[rows])

    return pieces
