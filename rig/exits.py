"""What an ending means to whoever called: one exit code for every outcome, verdict and error.


| exit code | meaning |
|---|---|
| 0 | done; of a gear: PASS, or NOT JUDGED |
| 1 | FAIL: a quantity breaks its limit by more than its expanded uncertainty |
| 2 | usage: an argument, a parameter, a plan or a configuration that cannot be accepted; nothing has moved |
| 3 | MARGINAL: whether a limit is kept is uncertain |
| 4 | ABORTED by the operator |
| 5 | TRIPPED by the supervisor |
| 6 | ERROR or INTERRUPTED: a file, a device, or the program |
| 7 | NOT JUDGED, where `--require-verdict` asks for a verdict |
| 8 | BUSY: another process has this bench; nothing was connected |

First the outcome of the run that the command made decides; only of one that was COMPLETED, and of a command that judges
without running (fit, report, certificate), the verdict on the gear. Of a run that was not brought to its end that
verdict is NOT JUDGED. Several verdicts end as the worst of them.
"""

from __future__ import annotations

import tempfile
import traceback
from collections.abc import Iterable

from drivers.errors import DriverError, OtherMasterError
from experiments.errors import AnalysisError, ExtensionError, PlanError, SettingError
from model.errors import ModelError, ParameterError, WordedError, without_traceback
from rig.errors import BenchInUseError, ConfigurationError, LimitError, RigError

DONE, FAIL, USAGE, MARGINAL, ABORTED, TRIPPED, ERROR, NOT_JUDGED, BUSY = range(9)

_CODE_OF_OUTCOME: dict[str, int] = {
    "COMPLETED": DONE,
    "ABORTED": ABORTED,
    "TRIPPED": TRIPPED,
    "ERROR": ERROR,
    "INTERRUPTED": ERROR,
}
_CODE_OF_VERDICT: dict[str, int] = {
    "PASS": DONE,
    "NOT JUDGED": DONE,
    "MARGINAL": MARGINAL,
    "FAIL": FAIL,
}

# The first row whose class fits decides; subclasses stand before their roots.
CODE_OF_ERROR: tuple[tuple[type[BaseException], int, str], ...] = (
    (ParameterError, USAGE, "A parameter cannot be accepted"),
    (SettingError, USAGE, "A setting cannot be accepted"),
    (ExtensionError, USAGE, "What another package brings cannot be used"),
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
    """The exit code of a run's outcome."""
    return _CODE_OF_OUTCOME.get(outcome, ERROR)


def code_of_verdict(verdict: str, *, required: bool = False) -> int:
    """The exit code of the verdict on a gear; `required`: whether having none is an ending of its own."""
    return NOT_JUDGED if required and verdict == "NOT JUDGED" else _CODE_OF_VERDICT[verdict]


def code_of_verdicts(verdicts: Iterable[str], *, required: bool = False) -> int:
    """The exit code of several verdicts: FAIL, then NOT JUDGED where a verdict is required, MARGINAL, PASS."""
    codes = [code_of_verdict(verdict, required=required) for verdict in verdicts]
    return next((code for code in (FAIL, NOT_JUDGED, MARGINAL) if code in codes), DONE)


def code_of_run(outcome: str, verdict: str, *, required: bool = False) -> int:
    """The exit code of a run: its outcome, and only where that is COMPLETED the verdict on its gear."""
    # What is done has the code zero, and leaves the word to the verdict.
    return code_of_outcome(outcome) or code_of_verdict(verdict, required=required)


def code_of_check(is_fine: bool, otherwise: int = ERROR) -> int:
    """The exit code of what was looked at and is fine, or is not."""
    return DONE if is_fine else otherwise


def explain(error: BaseException) -> tuple[int, str] | None:
    """Exit code and sentence of an expected error; None for one that is a defect of the program."""
    for kind, code, sentence in CODE_OF_ERROR:
        if isinstance(error, kind):
            text = without_traceback(str(error)).strip()
            return code, f"{sentence}: {text}" if text else f"{sentence}."
    return None


def error_object(error: BaseException, sentence: str) -> dict[str, dict[str, str | None]]:
    """An error as `--json` tells it: its kind, place, value, limit and remedy, and the whole sentence.

    A part that the error does not know is null.
    """
    worded = error if isinstance(error, WordedError) else None
    return {
        "error": {
            "kind": type(error).__name__,
            "where": _text(worded.where if worded else getattr(error, "param_hint", None)),
            "value": _text(worded and worded.value),
            "limit": _text(worded and worded.limit),
            "remedy": _text(worded and worded.remedy),
            "message": sentence,
        }
    }


def defect_in_words(error: BaseException) -> str:
    """What nobody expected, in a sentence: where its traceback lies for a report, and none of it in the message."""
    with tempfile.NamedTemporaryFile(
        "w", prefix="harmonic-rig-", suffix=".log", delete=False, encoding="utf-8"
    ) as log:
        traceback.print_exception(error, file=log)
    said = without_traceback(str(error))
    return (
        f"A defect of the program: {type(error).__name__}: {said}. "
        f"The details for its report are in {log.name}"
    )


def _text(part: object) -> str | None:
    return None if part is None or part == "" else str(part)
