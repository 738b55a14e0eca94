"""The head of a run: what it is, when, who, on which gear, how it ended, and the hash that names its file."""

from __future__ import annotations

import math
from pathlib import Path

from PySide6.QtWidgets import QFrame, QSizePolicy

from experiments.recording import Recording, RunMetadata
from rig.content.phrase import phrase
from rig.content.wording import duration_text, fixed
from rig.runfile.header import ORIGIN_WORDS
from rig.window.review.signals.data import duration_of
from rig.window.review.table_model import COLOURS, local_time, outcome_word, with_sign
from rig.window.shell.flow import in_flow
from rig.window.shell.sentence import first_of
from rig.window.shell.session import WindowSession
from rig.window.shell.stack import (
    in_column,
    push_button,
    restyled,
    set_tip,
    text_label,
)
from rig.window.work.verdicts import COLOURS as VERDICT_COLOURS
from rig.window.work.verdicts import ListedVerdict, verdict_reasons, verdict_text

_LEFT_BEHIND = "left behind"
"""What the library calls a run whose acquisition ended without sealing it."""
_SHOWN_HASH = 16
"""Characters of the SHA-256 that are shown; the whole of it is in the tip and can be copied."""


class RunHeaderView(QFrame):
    """The head. `show_recording`, or `show_problem` for a file that cannot be read."""

    def __init__(self, session: WindowSession) -> None:
        super().__init__()
        self._session = session
        self.setProperty("part", "card")
        self.title = text_label("", "title", selectable=True)
        self.outcome, self.mark = text_label(), text_label("", "mark")
        self.verdict = text_label()
        self.because = text_label("", "muted", wraps=True, selectable=True)
        self.because.hide()
        self.facts = text_label(wraps=True, selectable=True)
        self.file = text_label("", "muted", wraps=True, selectable=True)
        self.title.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        self.recover = push_button(
            "&Recover this run",
            "primary",
            tip="Make a run file of the rows that an acquisition left behind, and seal it",
        )
        self.recover.hide()
        self.report = push_button(
            "Open &report", tip="Write the report of this run as a web page (HTML) and open it"
        )
        self.pdf = push_button(
            "PDF", tip="Write the report of this run for paper (PDF) and open it"
        )
        ways = (self.recover, self.report, self.pdf)
        words = (self.mark, self.outcome, self.verdict)
        first = in_flow(self.title, *words, *ways, spacing=12)
        rest = (self.because, self.facts, self.file)
        self.setLayout(in_column(first, *rest, margins=(12, 7, 12, 7), spacing=2))

    def show_recording(self, recording: Recording, path: Path, state: str) -> None:
        """The head of a run; `state` as the library knows it."""
        m = recording.metadata
        self.title.setText(m.run_id or path.name)
        set_tip(self.title, str(path))
        self.mark.setText(ORIGIN_WORDS[m.origin])
        self.allow_report(state == "sealed")
        self.recover.setVisible(state == _LEFT_BEHIND)
        self._show_outcome(outcome_word(m.outcome, state))
        gear = (
            " ".join(part for part in (m.gear.name if m.gear else "", m.gear_serial) if part)
            or "gear not stated"
        )
        facts = [
            m.experiment or "no protocol",
            gear if m.gear_mounted else "no gear mounted",
            m.mounting.replace("-", " ") if m.is_said("mounting") else "mounting not stated",
            local_time(m.start_time) or "time not stated",
            duration_text(duration_of(recording)),
            m.operator or "nobody named",
        ]
        self.facts.setText(" · ".join(facts))
        rate = "" if math.isnan(m.sample_rate) else f" at {m.sample_rate:g} Hz"
        backend = ", ".join(f"{k} {m.process[k]}" for k in ("backend", "seed") if k in m.process)
        parts = [f"{fixed(recording.rows, 0)} rows{rate}", backend, _hash_words(m)]
        self.file.setText(" · ".join(part for part in parts if part))
        set_tip(self.file, m.seal)

    def show_verdict(self, listed: ListedVerdict | None) -> None:
        """What the run is worth, with the first reason; nothing for a run that is not sealed."""
        self.verdict.setText(verdict_text(listed))
        self.verdict.setVisible(listed is not None)
        reasons = verdict_reasons(listed).splitlines()
        self.because.setText(first_of(reasons))
        set_tip(self.because, "\n".join(reasons))
        self.because.setVisible(bool(reasons))
        if listed is not None:
            restyled(self.verdict, VERDICT_COLOURS[listed.judged.verdict])

    def allow_report(self, allowed: bool) -> None:
        """Whether a report can be asked for."""
        self.report.setEnabled(allowed)
        self.pdf.setEnabled(allowed)

    def show_problem(self, path: Path, state: str = "") -> None:
        """A file that cannot be read; `state` as the library knows it."""
        self.recover.setVisible(state == _LEFT_BEHIND)
        self.show_verdict(None)
        self.title.setText(path.name)
        self.mark.clear()
        self.allow_report(False)
        self._show_outcome("unreadable")
        self.facts.setText(str(path))
        self.file.clear()

    def _show_outcome(self, outcome: str) -> None:
        self.outcome.setText(with_sign(outcome))
        part = COLOURS.get(outcome, "bad") if outcome else "muted"
        restyled(self.outcome, "heading" if part == "accent" else part)


def _hash_words(metadata: RunMetadata) -> str:
    shown = phrase("SHA-256 {}…", metadata.sha256[:_SHOWN_HASH])
    return " · ".join(part for part in ("" if metadata.is_sealed else "NOT SEALED", shown) if part)
