"""Whether the suite passes where it is run: README's test command beside a load, by `nohup`, or in the background.

    python -m tests.benchmarks.suite_study --load 8        # beside four busy processes a core, on two cores
    python -m tests.benchmarks.suite_study --nohup
    python -m tests.benchmarks.suite_study --background    # `... &` of a script
    python -m tests.benchmarks.suite_study tests/rig/run    # some rooms, as of `python -m tests`

It makes the load itself. Prints what that command prints; processor time (user and system, with all processes that the tests
start), the largest resident memory of one of its processes, the wall time, and the load average before. Its exit code is that of the command.
Linux: memory is read from /proc.
"""  # noqa: E501

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.benchmarks.long_run import load_average

COMMAND = (sys.executable, "-m", "tests")
INTERVAL = 1.0
"""s between two looks at the memory of the rooms' processes."""
BUDGET_SECONDS, BUDGET_MEGABYTES = 800.0, 600.0
"""Processor time of the whole suite on quiet cores, and what one process may hold."""
IGNORED = {"nohup": (signal.SIGHUP,), "background": (signal.SIGINT, signal.SIGQUIT), "terminal": ()}
"""What a process is started to ignore: by `nohup`, by a shell that starts it with `&`."""


def ignoring(numbers: tuple[signal.Signals, ...]) -> Callable[[], None]:
    """What a child does before it begins: the signals ignored, the others as usual."""

    def prepare() -> None:
        for number in (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT):
            signal.signal(number, signal.SIG_IGN if number in numbers else signal.SIG_DFL)

    return prepare


@contextmanager
def busy(count: int) -> Iterator[None]:
    """So many processes that do nothing but compute."""
    load = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in load:
            process.kill()
            process.wait()


def children_of(parent: int) -> list[int]:
    """The processes that any thread of a process has started: those of the suite are its rooms'."""
    threads = Path(f"/proc/{parent}/task").glob("*")
    return [int(word) for t in threads for word in _read(parent, f"task/{t.name}/children").split()]


def resident(process: int) -> tuple[int, str]:
    """Bytes of a process that lie in memory, 0 once it has ended, and the last word of its command."""
    words = _read(process, "statm").split()
    last = _read(process, "cmdline").rstrip("\0").rpartition("\0")[2]
    return int(words[1]) * os.sysconf("SC_PAGE_SIZE") if words else 0, last


def _read(process: int, name: str) -> str:
    try:
        return Path(f"/proc/{process}/{name}").read_text()
    except OSError:
        return ""


def watch_memory(parent: int, over: threading.Event, most: dict[str, int]) -> None:
    """Keep the largest resident memory of each process until all is over, by the last file that it was given."""
    while not over.wait(INTERVAL):
        for held, last in map(resident, children_of(parent)):
            most[last] = max(held, most.get(last, 0))


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--load", type=int, default=0, help="busy processes beside the suite")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--nohup", dest="how", action="store_const", const="nohup")
    how.add_argument("--background", dest="how", action="store_const", const="background")
    parser.add_argument("places", nargs="*", help="folders or files of tests (all)")
    order = parser.parse_args()
    how_started = order.how or "terminal"
    before = (
        f"load average before: {load_average()}; busy beside: {order.load}; as by: {how_started}"
    )
    print(before, flush=True)
    began, over, most = time.monotonic(), threading.Event(), {"": 0}
    with busy(order.load):
        suite = subprocess.Popen(
            [*COMMAND, *order.places],
            preexec_fn=ignoring(IGNORED[how_started]),
        )
        watcher = threading.Thread(target=watch_memory, args=(suite.pid, over, most))
        watcher.start()
        _, status, used = os.wait4(suite.pid, 0)
        over.set()
        watcher.join()
    code = os.waitstatus_to_exitcode(status)
    suite.returncode = code
    processor = used.ru_utime + used.ru_stime
    print(
        f"processor time: {used.ru_utime:.0f} s user + {used.ru_stime:.0f} s system, "
        + beside(processor, BUDGET_SECONDS, "s")
    )
    last = max(most, key=lambda one: most[one])
    memory = most[last] / 1e6
    print(f"largest process: {memory:.0f} MB, " + beside(memory, BUDGET_MEGABYTES, "MB"))
    print(f"its last file: {last}")
    print(f"wall time: {time.monotonic() - began:.0f} s")
    return code


def beside(used: float, budget: float, unit: str) -> str:
    """What was used beside its budget, in words."""
    over = used - budget
    return f"{abs(over):.0f} {unit} {'over' if over > 0.0 else 'below'} the {budget:.0f} {unit} of the whole suite"


if __name__ == "__main__":
    raise SystemExit(main())
