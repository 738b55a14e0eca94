"""What somebody's callbacks may raise while a rig turns, and what becomes of the run.

| raised by                  | what                                               | the run                                         |
|----------------------------|----------------------------------------------------|-------------------------------------------------|
| `on_progress`, `on_event`  | an `Exception`                                     | goes on; an event and a warning say it          |
| any callback               | KeyboardInterrupt, SystemExit, any other that is none | STOP, the next of this kind an ABORT; raised at the end |
| `ask`, the serving itself  | anything                                           | STOP, the next of this kind an ABORT; raised at the end |

What has raised is not called again. "At the end" is once the rig was made safe and the file is sealed: a run is left
through standstill and no other way.
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from rig.run.stop import StopRequest

if TYPE_CHECKING:
    from experiments.recording import Event
    from experiments.steps.note import Prompt
    from rig.run.parts import Progress, RunReport

ASK: Final = "ask"
ON_PROGRESS: Final = "on_progress"
ON_EVENT: Final = "on_event"
SERVING: Final = "the thread that serves the run"
_ONLY_TELL: Final = frozenset({ON_PROGRESS, ON_EVENT})
"""What the run does not depend on."""


def ends_the_run(raised_by: str, error: BaseException) -> bool:
    """The rule: what only tells may fail; whoever raises anything else wants the run to end, or cannot answer it."""
    return raised_by not in _ONLY_TELL or not isinstance(error, Exception)


class Callbacks:
    """The callbacks of one run. Calling them raises nothing; `first` is what is to be raised at the end."""

    def __init__(
        self,
        stop: StopRequest,
        ask: Callable[[Prompt], str | None],
        on_progress: Callable[[Progress], None] | None = None,
        on_event: Callable[[Event], None] | None = None,
    ) -> None:
        self.first: BaseException | None = None
        self._stop = stop
        given: dict[str, Callable[[Any], Any] | None]
        given = {ASK: ask, ON_PROGRESS: on_progress, ON_EVENT: on_event}
        self._in_use = {name: called for name, called in given.items() if called is not None}

    def hears(self, name: str) -> bool:
        """Whether there is such a callback that has not raised."""
        return name in self._in_use

    def ask(self, prompt: Prompt) -> str | None:
        """The answer to a prompt, None while there is none."""
        answer: str | None = self._call(ASK, prompt)
        return answer

    def on_progress(self, progress: Progress) -> None:
        """Tell progress."""
        self._call(ON_PROGRESS, progress)

    def on_event(self, event: Event) -> None:
        """Tell an event."""
        self._call(ON_EVENT, event)

    def took(self, raised_by: str, error: BaseException) -> None:
        """Something was raised: what the rule says of it."""
        words = f"{raised_by} raised {type(error).__name__}: {error}".rstrip(": ")
        if not ends_the_run(raised_by, error):
            self._stop.problem(f"{words}; it was not called any more")
            return
        if self.first is not None:
            self._stop.abort(by=words)
        elif isinstance(error, KeyboardInterrupt):
            # A Ctrl-C for which nobody had set a handler: after a STOP it is an ABORT, as it always is.
            self._stop.press(by=words)
        else:
            self._stop.stop(by=words)
        self.first = self.first or error
        self._stop.problem(words)

    def _call(self, name: str, told: Any) -> Any:
        called = self._in_use.get(name)
        if called is None:
            return None
        try:
            return called(told)
        except BaseException as error:  # noqa: BLE001  the rule decides; it is raised again once the rig stands
            self._in_use.pop(name, None)
            self.took(name, error)
            return None


def brought_to_its_end(
    run: Callable[[], RunReport], callbacks: Callbacks, stop: StopRequest
) -> RunReport:
    """The report of a run; raises what was raised in it first, with a note that says how the run ended."""
    try:
        report = run()
    except BaseException as error:
        if callbacks.first is None:
            raise
        callbacks.first.add_note(f"The run ended with {type(error).__name__}: {error}")
        raise callbacks.first from error
    # What was raised after the file had been sealed can only be said here.
    report.warnings.extend(stop.take_problems())
    if callbacks.first is not None:
        callbacks.first.add_note(how_it_ended(report))
        raise callbacks.first
    return report


def how_it_ended(report: RunReport) -> str:
    """One sentence for somebody who gets an error in place of a report."""
    standing = "standstill was verified" if report.safe else "STANDSTILL WAS NOT VERIFIED"
    remedy = "" if report.safe else " Press the emergency stop."
    return f"The run ended {report.outcome}, {standing}: {report.path}.{remedy}"
