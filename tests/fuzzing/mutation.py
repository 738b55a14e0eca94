"""Mutations of what is accepted: bits, bytes, numbers, lengths, pieces of another. Same seed, same inputs."""

from __future__ import annotations

import random
import re
from collections.abc import Sequence

EDGES = (0x00, 0x01, 0x7F, 0x80, 0xFF, 0x20, 0x0A, 0x3F)
NUMBERS = (
    b"0", b"-1", b"nan", b"-inf", b"1e400", b"1e-400", b"18446744073709551616", b"-2147483649",
    b"0x", b"", b"007", b"1_0", b"9" * 40, b"true", b'""', b"[]", b"1979-05-27", b"0.1.2",
)  # fmt: skip
_NUMBER = re.compile(rb"-?\d[\d.]*(?:[eE][-+]?\d+)?")


class Mutator:
    """Draws one input after the other out of a stated seed."""

    def __init__(self, seed: int, seeds: Sequence[bytes], most: int = 8) -> None:
        self._random, self._seeds, self._most = random.Random(seed), seeds, most

    def draw(self) -> bytes:
        """One to a few mutations of one of the accepted messages."""
        data = self._random.choice(self._seeds)
        for _ in range(self._random.choice((1, 1, 1, 2, 3, self._most))):
            data = self._random.choice(_MUTATIONS)(self._random, data, self._seeds)
        return data


def _bit(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    at = rng.randrange(len(data) or 1)
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :] if data else data


def _byte(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + bytes([rng.choice(EDGES)]) + data[at + 1 :]


def _cut(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    first, last = sorted((rng.randrange(len(data) + 1), rng.randrange(len(data) + 1)))
    return data[:first] + data[last:]


def _shorten(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _repeat(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    first = rng.randrange(len(data) + 1)
    last = min(len(data), first + rng.randint(1, 64))
    return data[:last] + data[first:last] * rng.randint(1, 3) + data[last:]


def _insert(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.randbytes(rng.randint(1, 8)) + data[at:]


def _splice(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    other = rng.choice(seeds)
    return data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]


def _number(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    """Another number where one stands; among the first and the last of them in a long text."""
    found = list(_NUMBER.finditer(data[:20_000]))
    if not found:
        return _byte(rng, data, seeds)
    match = rng.choice(found)
    return data[: match.start()] + rng.choice(NUMBERS) + data[match.end() :]


_MUTATIONS = (_bit, _byte, _cut, _shorten, _repeat, _insert, _splice, _number)
