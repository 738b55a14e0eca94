"""What a run in real time asks of the computer: a place in the real-time class, and to stay in
memory. Refusals are said.
"""

from __future__ import annotations

import ctypes
import os
import sys

from experiments.finding import Finding, Severity

_MCL_CURRENT_AND_FUTURE = 3


def claim_real_time(priority: int, lock_memory: bool) -> tuple[Finding, ...]:
    """Ask for SCHED_FIFO with this priority (0: do not ask) and for locked memory. What was refused is a warning."""
    checks: list[Finding] = []
    if priority > 0:
        checks.append(_claim_priority(priority))
    if lock_memory:
        checks.append(_lock_memory())
    return tuple(checks)


def _claim_priority(priority: int) -> Finding:
    remedy = "Allow it (ulimit -r, or CAP_SYS_NICE), or set real_time.scheduler_priority = 0."
    if sys.platform != "linux":
        return Finding(
            "scheduler",
            Severity.WARNS,
            f"{sys.platform} has no SCHED_FIFO: the loop is scheduled like any program",
        )
    try:
        for thread in _threads():
            os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, ValueError) as error:
        return Finding(
            "scheduler", Severity.WARNS, f"SCHED_FIFO {priority} was refused: {error}", remedy
        )
    return Finding("scheduler", Severity.PASSED, f"SCHED_FIFO with priority {priority}")


def _threads() -> list[int]:
    """Every thread of this process: one of the usual class that holds the interpreter would hold up the loop."""
    try:
        return [int(name) for name in os.listdir("/proc/self/task")]
    except (OSError, ValueError):
        return [0]


def _lock_memory() -> Finding:
    try:
        library = ctypes.CDLL(None, use_errno=True)
        refused = library.mlockall(_MCL_CURRENT_AND_FUTURE)
    except (OSError, AttributeError, TypeError) as error:
        return Finding(
            "memory", Severity.WARNS, f"memory cannot be locked on {sys.platform}: {error}"
        )
    if refused:
        reason = os.strerror(ctypes.get_errno())
        return Finding(
            "memory",
            Severity.WARNS,
            f"memory was not locked: {reason}",
            "Raise `ulimit -l`, or set lock_memory = false.",
        )
    return Finding("memory", Severity.PASSED, "locked")
