"""Questions of a run to whoever sits at the terminal.

Nothing waits here: while a question stands the rig is watched, and Ctrl-C is heard at once. Consent is a word
that is typed; Enter alone is none, nor is the end of the input.
"""

from __future__ import annotations

import queue
import sys
import threading
from collections.abc import Callable, Iterable

from experiments.steps.note import Prompt
from rig.commands.terminal import echo
from rig.run.remote import PATIENCE, RemoteOperator, lines_of
from rig.run.stop import StopRequest

CONSENT = "yes"
"""What has to be typed to consent."""
NOBODY = "(nobody at the terminal: not answered)"


class TerminalOperator:
    """Whoever sits at a terminal. `say` shows one text; lines come in by `listen`."""

    def __init__(self, stop: StopRequest, say: Callable[[str], None]) -> None:
        self._stop, self._say = stop, say
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._asked: Prompt | None = None

    def listen(self, lines: Iterable[str]) -> None:
        """Take lines until they end."""
        for line in lines:
            self._lines.put(line)
        self._lines.put(None)

    def ask(self, prompt: Prompt) -> str | None:
        """Put a prompt once; the answer, or None while there is none. The end of the input is a STOP."""
        if self._asked is not prompt:
            self._asked = prompt
            # What was typed before the question was meant for something else.
            while not self._lines.empty() and self._take() is not None:
                pass
            self._say(wording(prompt))
        try:
            line = self._take(PATIENCE)
        except queue.Empty:
            return None
        if line is None:
            self._stop.stop()
            return None
        typed = line.strip()
        if typed.lower() != CONSENT if prompt.consent else not typed:
            self._say(wording(prompt))
            return None
        self._asked = None
        return prompt.consent or typed

    def _take(self, patience: float = 0.0) -> str | None:
        """The next line, None at the end of the input, which stays its end. Raises `queue.Empty`."""
        line = self._lines.get(timeout=patience)
        if line is None:
            self._lines.put(None)
        return line


def wording(prompt: Prompt) -> str:
    """A prompt as the terminal shows it, with what has to be typed."""
    if not prompt.consent:
        return f"\n{prompt.text} Type the answer, then Enter: "
    return f"\n{prompt.text}\n{prompt.consent}: type {CONSENT}, then Enter, if that is so: "


def terminal_ask(stop: StopRequest) -> Callable[[Prompt], str | None]:
    """How a run of this terminal asks; without one it goes on and says so."""
    if not sys.stdin.isatty():
        return lambda prompt: NOBODY
    operator: list[TerminalOperator] = []

    def ask(prompt: Prompt) -> str | None:
        # Not before the first question: until then the keyboard belongs to whatever else reads it.
        if not operator:
            operator.append(TerminalOperator(stop, _show))
            threading.Thread(
                target=operator[0].listen,
                args=(lines_of(sys.stdin.fileno()),),
                name="terminal",
                daemon=True,
            ).start()
        return operator[0].ask(prompt)

    return ask


def program_ask(
    remote: RemoteOperator, stop: StopRequest, *, listens: bool
) -> Callable[[Prompt], str | None]:
    """How a run of a program asks: the program, where that answers on standard input, else whoever is at a terminal."""
    return remote.ask if listens else terminal_ask(stop)


def _show(text: str) -> None:
    echo(text, errors=True, is_line=False)
