"""The drivers' own share of a cycle: processor time of an exchange, the devices replaced by a tape of what they answered.

    python tests/benchmarks/cycle_share.py CHECKOUT [BLOCKS] [--bound]

runs the drivers of any checkout, so that two versions can be measured in turn; prints the least and the median of so many blocks
of a thousand cycles [us per cycle].
"""  # noqa: E501

from __future__ import annotations

import argparse
import gc
import importlib
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

SYNC = 0x80
ANSWERS = range(0x180, 0x380)
"""COB-IDs of process data that nodes send."""


class Tape:
    """A bus that answers each SYNC with what the bench answered to one, and hands back what was sent."""

    def __init__(self, raw: Any, commands: set[int]) -> None:
        self.is_recording = True
        self._raw, self._commands = raw, commands
        self._answers: list[list[Any]] = []
        self._waiting: list[Any] = []
        self._turn = 0

    def send(self, message: Any) -> None:
        """Send to the bench, or take the answers from the tape."""
        if self.is_recording:
            self._raw.send(message)
            return
        self._waiting.append(message)
        if message.arbitration_id == SYNC:
            self._waiting += self._answers[self._turn % len(self._answers)]
            self._turn += 1

    def recv(self, timeout: float | None = None) -> Any:
        """What the bench says, kept on the tape; or what waits."""
        if not self.is_recording:
            return self._waiting.pop(0) if self._waiting else None
        message = self._raw.recv(timeout)
        if message is None:
            return None
        number = message.arbitration_id
        if number == SYNC:
            self._answers.append([])
        elif self._answers and number in ANSWERS and number not in self._commands:
            self._answers[-1].append(message)
        return message

    def shutdown(self) -> None:
        """Close the bench."""
        self._raw.shutdown()

    def replay(self, frames: int) -> None:
        """From now on answer from the tape, of which each cycle must have so many frames."""
        self._answers = [each for each in self._answers if each]
        assert all(len(each) == frames for each in self._answers)
        self.is_recording = False


def measured(blocks: int, *, has_bound: bool) -> list[float]:
    """Processor time per cycle [us] of each block."""
    port = importlib.import_module("drivers.port")
    wire = importlib.import_module("tests.benchmarks.test_wire_speed")
    rig = wire.bench("wire").port
    segment = rig.segment
    bus = segment._bus
    tape = Tape(bus._raw, {pdo.cob_id for pdo in segment.nodes.drive.commands})
    bus._raw = tape
    command = port.Command(port.Mode.SPEED, np.full(wire.CYCLES, wire.SPEED))
    for _ in range(2):
        rig.exchange(command, wire.CYCLES, port.Guard())
    tape.replay(len(segment.nodes.layout.pdos))
    bus._pump = segment._clock.wait_until_ns
    for node in bus.nodes.values():
        node.timeout_ns = 0
    bound = port.Bound(cause="x", weights={"input_angle": 1e-30}, high=1e9, low=-1e9, lag=4)
    guard = port.Guard((bound,)) if has_bound else port.Guard()
    times: list[float] = []
    gc.disable()
    for _ in range(blocks):
        began = time.process_time()
        block = rig.exchange(command, wire.CYCLES, guard)
        times.append(1e6 * (time.process_time() - began) / wire.CYCLES)
        assert len(block) == wire.CYCLES
    return times


def main() -> None:
    """Measure one checkout."""
    parser = argparse.ArgumentParser(description="The drivers' own share of a cycle.")
    parser.add_argument("checkout", type=Path)
    parser.add_argument("blocks", type=int, nargs="?", default=15)
    parser.add_argument(
        "--bound", action="store_true", help="with a bound that looks four cycles back"
    )
    chosen = parser.parse_args()
    sys.path.insert(0, str(chosen.checkout.resolve()))
    times = measured(chosen.blocks, has_bound=chosen.bound)
    print(f"least {min(times):.2f} us, median {float(np.median(times)):.2f} us")


if __name__ == "__main__":
    main()
