"""The causes that a drill can expect and a run can show, in one vocabulary.

A cause is a trip (`rig.run.trips`), a word of the operator, the recorder, a mark of the cycles, a
check that refused, a reading that was refused, or a stage of making safe that was not obeyed. What
a drill declares and what is read from a run is made by the same functions, so that both can be
compared as they stand.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from drivers.samples import CycleFlag
from experiments.recording import Event
from rig.run.make_safe import Stage

NOTHING = ""
"""Where there is nothing to detect: the counts just stay right."""
STOP = "STOP"
ABORT = "ABORT"
NO_VALUE = "the readout says that its value is none (?)"

_REFUSED = "preflight"


def marked(flag: CycleFlag) -> str:
    """Cycles carry this mark."""
    return f"marked {flag.name}"


def refused(check: str) -> str:
    """A check before arming refused; nothing has moved."""
    return f"refused before arming: {check}"


def reading_refused(what: str) -> str:
    """The readout's driver gave this error instead of an angle."""
    return f"reading refused: {what}"


def not_obeyed(stage: Stage | str) -> str:
    """Making safe saw that this stage was not obeyed, and went on with the next."""
    return f"{stage.value if isinstance(stage, Stage) else stage} not seen to be obeyed"


def causes_of_events(events: Iterable[Event]) -> Iterator[str]:
    """What ended a run, by the events that it told: trips, the operator's words, the recorder, checks that refused."""
    for event in events:
        if event.source == "session" and event.code != _REFUSED:
            yield event.code
        elif event.source == _REFUSED and event.level == "error":
            yield refused(event.text.partition(":")[0])
