"""What an ending means to whoever called: one exit code and one sentence for every outcome and every error.

| code | meaning |
|---|---|
| 0 | done, or the verdict is PASS |
| 1 | the verdict is FAIL |
| 2 | usage: an argument, a parameter, a plan or a configuration that cannot be accepted; nothing has moved |
| 3 | the verdict is MARGINAL |
| 4 | ABORTED by the operator |
| 5 | TRIPPED by the supervisor |
| 6 | ERROR: a file, a device or the program itself |
| 7 | BUSY: another process has this bench; nothing was connected |
"""

from __future__ import annotations

from drivers.errors import DriverError, OtherMasterError
from experiments.errors import AnalysisError, PlanError
from model.errors import ModelError, ParameterError
from rig.errors import BenchInUseError, ConfigurationError, LimitError, RigError

DONE, FAIL, USAGE, MARGINAL, ABORTED, TRIPPED, ERROR, BUSY = range(8)

CODE_OF_OUTCOME: dict[str, int] = {
    "PASS": DONE,
    "FAIL": FAIL,
    "MARGINAL": MARGINAL,
    "ABORTED": ABORTED,
    "TRIPPED": TRIPPED,
    "ERROR": ERROR,
    "INTERRUPTED": ERROR,
}

# The first row whose class fits decides; subclasses stand before their roots.
CODE_OF_ERROR: tuple[tuple[type[BaseException], int, str], ...] = (
    (ParameterError, USAGE, "A parameter cannot be accepted"),
    (PlanError, USAGE, "This protocol cannot be planned"),
    (LimitError, USAGE, "A limit of the rig or the gear would be broken"),
    (ConfigurationError, USAGE, "The configuration cannot be accepted"),
    (BenchInUseError, BUSY, "This bench is in use"),
    (AnalysisError, ERROR, "This recording cannot be analysed"),
    (ModelError, ERROR, "The model cannot do this"),
    (OtherMasterError, ERROR, "This rig is led by somebody else"),
    (DriverError, ERROR, "The rig's hardware did not do what it must"),
    (RigError, ERROR, "This could not be done"),
    (KeyboardInterrupt, ABORTED, "Stopped by the operator"),
    (MemoryError, ERROR, "The computer is out of memory"),
    (OSError, ERROR, "The operating system refused a file or a device"),
)


def code_of_outcome(outcome: str) -> int:
    """The exit code of a run's or a verdict's outcome."""
    return CODE_OF_OUTCOME.get(outcome, ERROR)


def explain(error: BaseException) -> tuple[int, str] | None:
    """Exit code and sentence of an expected error; None for one that is a defect of the program."""
    for kind, code, sentence in CODE_OF_ERROR:
        if isinstance(error, kind):
            text = str(error).strip()
            return code, f"{sentence}: {text}" if text else f"{sentence}."
    return None
