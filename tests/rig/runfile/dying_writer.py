"""A writer in a process of its own: acknowledges on stdout what it has flushed, goes on when told
on stdin, and is killed.
"""

import sys
from pathlib import Path

from experiments.recording import Event, Segment
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import block, header


def main(folder: str, compress: str, chunk_rows: str) -> None:
    writer = RunWriter(
        Path(folder) / "00001-friction-A1.h5",
        header(),
        compress=compress == "c",
        chunk_rows=int(chunk_rows),
    )
    first = segments = 0
    print("ready", flush=True)
    for command in iter(lambda: sys.stdin.read(1), ""):
        if command == "a":
            writer.append(block(first, 37))
            first += 37
        elif command == "g":
            writer.segment(
                Segment(
                    index=segments,
                    label="hold",
                    start=max(first - 37, 0),
                    stop=-1 if segments % 2 else first,
                )
            )
            writer.event(Event(first, "info", "NOTE", "writer", f"row {first}"))
            segments += 1
        elif command in "fs":
            writer.flush() if command == "f" else writer.synchronise()
            print(writer.rows, flush=True)
        elif command == "r":
            print("ready", flush=True)
        elif command == "w":
            # Writes without end until it is killed from outside, acknowledging every flush.
            while True:
                writer.append(block(first, 37))
                first += 37
                writer.flush()
                print(writer.rows, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
