"""A small part of the fuzzing: the accepted is accepted, the mutated is accepted or refused in our own words."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import pytest

from tests.fuzzing.decoders import DECODERS
from tests.fuzzing.mutation import Mutator
from tests.fuzzing.readers import OWN, READERS, Reader, failures

forks = pytest.mark.skipif(not hasattr(os, "fork"), reason="files are read in a forked child")


@pytest.mark.parametrize("name", DECODERS)
def test_accepted_messages_are_accepted(name: str) -> None:
    for seed in DECODERS[name].seeds:
        DECODERS[name].feed(seed)


@pytest.mark.parametrize("name", DECODERS)
def test_mutated_messages_are_refused_in_our_own_words(name: str) -> None:
    decoder = DECODERS[name]
    mutator = Mutator(1, decoder.seeds)
    for _ in range(400):
        with contextlib.suppress(*OWN):
            decoder.feed(mutator.draw())


@forks
@pytest.mark.parametrize("name", READERS)
def test_mutated_files_are_refused_in_our_own_words(name: str) -> None:
    reader = READERS[name]
    mutator = Mutator(1, reader.seeds())
    # MATLAB files are first read by a process of their own, which costs a second each.
    count = 3 if name == "MAT" else 12
    assert failures(reader, [mutator.draw() for _ in range(count)]) == []


@forks
@pytest.mark.parametrize("name", READERS)
def test_accepted_files_are_accepted(name: str) -> None:
    reader = READERS[name]

    def strictly(path: Path) -> None:
        try:
            reader.read(path)
        except OWN as error:
            raise AssertionError(str(error)) from error

    assert failures(Reader(reader.seeds, reader.suffix, strictly), reader.seeds()) == []


@forks
def test_what_kills_a_reader_is_told() -> None:
    """Of whoever looks for deaths it must be known that he sees them."""

    def read(path: Path) -> None:
        if path.read_bytes() == b"kill":
            os.abort()
        if path.read_bytes() == b"raise":
            raise KeyError("not one of ours")

    found = failures(Reader(list, ".x", read), [b"fine", b"kill", b"fine", b"raise", b"fine"])
    assert [data for data, _ in found] == [b"kill", b"raise"]
    assert "signal 6" in found[0][1]
    assert "KeyError" in found[1][1]
