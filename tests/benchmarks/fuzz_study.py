"""Fuzzing in numbers: `python -m tests.benchmarks.fuzz_study --decoders 100000 --readers 1000 --seed 1`.

`--only NAME` takes those whose names contain it. Prints one line for each decoder and each reader, and the
inputs that raised something else than our own errors.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Iterator

from tests.fuzzing.decoders import DECODERS, Decoder
from tests.fuzzing.mutation import Mutator
from tests.fuzzing.readers import OWN, READERS, Reader, failures

BATCH = 100
"""Files that one child process reads."""


def fuzz_decoder(decoder: Decoder, count: int, seed: int) -> tuple[int, list[str]]:
    """How many of the inputs were accepted, and what went wrong."""
    mutator, accepted, wrong = Mutator(seed, decoder.seeds), 0, []
    for _ in range(count):
        data = mutator.draw()
        try:
            decoder.feed(data)
            accepted += 1
        except OWN:
            continue
        except Exception as error:  # noqa: BLE001  what is looked for
            wrong.append(f"{data.hex(' ')}: {type(error).__name__}: {error}")
    return accepted, wrong


def fuzz_reader(reader: Reader, count: int, seed: int) -> list[str]:
    """What went wrong with the inputs."""
    mutator = Mutator(seed, reader.seeds())

    def batches() -> Iterator[list[bytes]]:
        for start in range(0, count, BATCH):
            yield [mutator.draw() for _ in range(min(BATCH, count - start))]

    return [
        f"{len(data)} bytes, beginning {data[:60]!r}: {text}"
        for batch in batches()
        for data, text in failures(reader, batch)
    ]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--decoders", type=int, default=100_000, help="inputs of each decoder")
    parser.add_argument("--readers", type=int, default=1000, help="files of each reader")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="part of a name")
    chosen = parser.parse_args()
    warnings.simplefilter("error")
    for name, decoder in DECODERS.items():
        if chosen.only in name and chosen.decoders:
            start = time.monotonic()
            accepted, wrong = fuzz_decoder(decoder, chosen.decoders, chosen.seed)
            share, seconds = accepted / chosen.decoders, time.monotonic() - start
            print(
                f"| {name} | {chosen.decoders} | {share:.0%} accepted | {len(wrong)} wrong | {seconds:.0f} s |"
            )
            print("\n".join(wrong[:10]), flush=True)
    for name, reader in READERS.items():
        if chosen.only in name and chosen.readers:
            start = time.monotonic()
            wrong = fuzz_reader(reader, chosen.readers, chosen.seed)
            print(
                f"| {name} | {chosen.readers} | | {len(wrong)} wrong | {time.monotonic() - start:.0f} s |"
            )
            print("\n".join(wrong[:10]), flush=True)


if __name__ == "__main__":
    main()
