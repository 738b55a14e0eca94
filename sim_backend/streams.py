"""Random numbers as pure functions: of a seed and a name, and for noise also of the SYNC cycle.

Noise is drawn in aligned chunks of cycles, each from its own counter of a Philox generator. So
cycle 123 456 of a channel has the same noise however a run is cut into blocks, and switching one
imperfection off leaves all others as they were.
"""

from __future__ import annotations

import zlib

import numpy as np

from model.arrays import FloatArray

CHUNK = 1024
"""Cycles that are drawn together."""


def stream(seed: int, name: str) -> np.random.Generator:
    """The generator that belongs to a seed and a name: for what is drawn once per rig, gear or run."""
    key = np.array([seed & 0xFFFFFFFFFFFFFFFF, zlib.crc32(name.encode())], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key))


def bounded(random: np.random.Generator) -> float:
    """A standard normal number, drawn again beyond three sigma."""
    while True:
        drawn = float(random.standard_normal())
        if abs(drawn) <= 3.0:
            return drawn


class CycleNoise:
    """Standard normal noise of one channel, one number per SYNC cycle."""

    def __init__(self, seed: int, name: str) -> None:
        key = [seed & 0xFFFFFFFFFFFFFFFF, zlib.crc32(name.encode()) | 1 << 40]
        self._bits = np.random.Philox(key=np.array(key, dtype=np.uint64))
        self._generator = np.random.Generator(self._bits)
        # Put back with another counter for each chunk: half as long as a new generator takes.
        self._begin = self._bits.state
        self._drawn: dict[int, FloatArray] = {}

    def at(self, first_cycle: int, cycles: int) -> FloatArray:
        """The numbers of `cycles` cycles from `first_cycle` on (cycles,)."""
        out = np.empty(cycles)
        done = 0
        while done < cycles:
            chunk, offset = divmod(first_cycle + done, CHUNK)
            take = min(CHUNK - offset, cycles - done)
            out[done : done + take] = self._of_chunk(chunk)[offset : offset + take]
            done += take
        return out

    def _of_chunk(self, chunk: int) -> FloatArray:
        """The chunk's numbers; the latest two are kept, because blocks seldom end where chunks do."""
        if chunk not in self._drawn:
            while len(self._drawn) > 1:
                del self._drawn[min(self._drawn)]
            self._begin["state"]["counter"][3] = chunk
            self._bits.state = self._begin
            self._drawn[chunk] = self._generator.standard_normal(CHUNK)
        return self._drawn[chunk]
