"""A writer in a process of its own whose file may not grow beyond a size: says what was
acknowledged and how it ended.
"""

import json
import resource
import sys
from pathlib import Path

import numpy as np

from drivers.samples import SampleBlock
from rig.errors import RunFileError
from rig.run.recorder import InlineRecorder, ThreadedRecorder
from rig.runfile.write import RunWriter
from tests.rig.runfile.making import CYCLE_NS, header


def incompressible(first: int, rows: int) -> SampleBlock:
    """A block whose every row follows from its cycle and which nothing can compress."""
    cycles = np.arange(first, first + rows, dtype=np.int64)
    noise = (cycles * 0x2545F4914F6CDD1D) % 2**61
    counts = np.stack([noise, -noise, noise % 2**31, noise % 1021], axis=1)
    return SampleBlock(first, cycles * CYCLE_NS, counts, np.zeros(rows, dtype=np.uint16))


def main(folder: str, kind: str, limit: str) -> None:
    writer = RunWriter(
        Path(folder) / "1-x-y.h5", header(), compress=kind == "inline", chunk_rows=512
    )
    recorder = (
        InlineRecorder(writer, flush_interval=0.0)
        if kind == "inline"
        else ThreadedRecorder(writer, 1000.0)
    )
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), int(limit)))
    stored, errors = 0, []
    for first in range(0, 1_000_000, 100):
        try:
            recorder.put(incompressible(first, 100))
            if kind != "inline":
                recorder.flush()
            stored = writer.rows_stored
        except RunFileError as error:
            errors.append(str(error))
            if len(errors) == 2:
                break
    try:
        recorder.close("COMPLETED")
    except RunFileError as error:
        errors.append(str(error))
    recorder.abandon()
    print(json.dumps({"stored": stored, "errors": errors}))


if __name__ == "__main__":
    main(*sys.argv[1:])
