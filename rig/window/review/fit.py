"""Fits asked for from the window: each a `rig fit` in a process of its own, one after the other, their results kept."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Signal

from experiments.result import Result
from model.errors import WordedError
from rig.analysis.fit.digest import choices_of
from rig.analysis.in_force import InForce
from rig.analysis.result_data import result_from_mapping
from rig.analysis.store import Analysis
from rig.analysis.tare import tare_kind
from rig.library.index import IndexedRun, fingerprint_of
from rig.window.work.background import BackgroundCommand, in_words

_MOST_KEPT = 40
"""Results with their figures that are kept in memory; the oldest go first."""


@dataclass(frozen=True)
class FitOrder:
    """One fit: of which run, as what kind ("" the protocol's), with which tare and parameter set (None: the run's own).

    `settings` are pairs for `--set`; `keep` appends the analysis to the store beside the run.
    """

    run: Path
    kind: str = ""
    tare: Path | None = None
    parameters: Path | None = None
    settings: tuple[tuple[str, str], ...] = ()
    keep: bool = False

    @property
    def arguments(self) -> list[str]:
        """Everything after `rig`."""
        words = ["fit", *filter(None, (self.kind,)), str(self.run)]
        words += [*option("--tare", self.tare), *option("--parameters", self.parameters)]
        for name, value in self.settings:
            words += ["--set", f"{name}={value}"]
        return [*words, "--json", "--plots", "--store" if self.keep else "--no-store"]

    def key(self) -> tuple[Any, ...]:
        """What must be the same for the same result: what is asked for, and the files as they are now."""
        files = (self.run, self.tare, self.parameters)
        return (
            self.kind,
            self.settings,
            *((str(file), fingerprint_of(file)) for file in files if file is not None),
        )


def order_of(analysis: Analysis, run: Path, runs: Mapping[str, Path]) -> FitOrder:
    """The fit that a stored analysis was, to be made again; `known` are the runs of the folder by their name."""
    tare = runs.get(str(analysis.content.get("tare", {}).get("run", "")))
    settings = tuple(
        (name, _setting(value)) for name, value in analysis.content.get("settings", {}).items()
    )
    return FitOrder(run, analysis.kind, tare, None, settings)


def renewal_of(run: Path, found: InForce) -> FitOrder | None:
    """The fit that makes an analysis in force anew, with what was chosen by hand when it was made.

    None where that was a parameter set, or to leave a tare away: both are chosen again by hand.
    """
    try:
        choices = choices_of(run, found)
    except WordedError:
        return None
    if choices.gear is not None or choices.no_tare or choices.largest_missed_share is not None:
        return None
    settings = tuple((name, _setting(value)) for name, value in choices.settings.items())
    return FitOrder(run, found.kind, choices.tare, None, settings, keep=True)


def tares_among(runs: Iterable[IndexedRun], origin: str) -> list[IndexedRun]:
    """The runs that may be subtracted as a tare from one of this origin, the newest last."""
    return [
        run
        for run in runs
        if run.protocol == tare_kind() and run.origin == origin and run.is_complete
    ]


def option(flag: str, value: str | Path | None) -> list[str]:
    """An option of a command; nothing where it is not set."""
    return [flag, str(value)] if value else []


def _setting(value: Any) -> str:
    return ",".join(str(part) for part in value) if isinstance(value, (list, tuple)) else str(value)


ResultCache = dict[tuple[Any, ...], Result]


class FitDesk(QObject):
    """Takes orders and has them worked off one at a time. `cache` may be shared by several desks."""

    fitted = Signal(object, object)
    """Order and `Result`."""
    refused = Signal(object, str)
    """Order, and in words why there is no result."""
    progressed = Signal(int, int)
    """How many of how many orders are done; equal when there is nothing left to do."""

    def __init__(self, cache: ResultCache | None = None, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.cache: ResultCache = {} if cache is None else cache
        self._waiting: deque[FitOrder] = deque()
        self._command: BackgroundCommand | None = None
        self._done = self._asked = 0

    @property
    def is_running(self) -> bool:
        """Whether a fit is at work."""
        return self._command is not None

    def _cached_result(self, order: FitOrder) -> Result | None:
        """The result of an order that was worked off already."""
        return self.cache.get(order.key())

    def ask(self, *orders: FitOrder) -> None:
        """Work these off; what is known already is told at once."""
        self._asked += len(orders)
        self._waiting.extend(orders)
        self._next()

    def cancel(self) -> None:
        """Give up what is at work and what waits."""
        self._waiting.clear()
        if self._command is not None:
            self._command.cancel()
            self._command.deleteLater()
            self._command = None
        self._done = self._asked = 0
        self.progressed.emit(0, 0)

    def _next(self) -> None:
        while self._waiting and self._command is None:
            order = self._waiting.popleft()
            cached = None if order.keep else self._cached_result(order)
            if cached is not None:
                self._count(order, cached)
                continue
            self._command = BackgroundCommand(
                order.arguments,
                self,
                lambda code, out, aside, order=order: self._take(order, out, aside),
            )
            self._command.start()
            self.progressed.emit(self._done, self._asked)

    def _take(self, order: FitOrder, out: str, complaint: str) -> None:
        if self._command is not None:
            self._command.deleteLater()
            self._command = None
        try:
            result = result_from_mapping(json.loads(out))
        except (ValueError, KeyError, TypeError):
            self._count(order, in_words(complaint))
        else:
            self._remember(order, result)
            self._count(order, result)
        self._next()

    def _remember(self, order: FitOrder, result: Result) -> None:
        self.cache[order.key()] = result
        while len(self.cache) > _MOST_KEPT:
            del self.cache[next(iter(self.cache))]

    def _count(self, order: FitOrder, answer: Result | str) -> None:
        self._done += 1
        done, asked = self._done, self._asked
        if done == asked:
            self._done = self._asked = 0
        self.progressed.emit(done, asked)
        if isinstance(answer, str):
            self.refused.emit(order, answer)
        else:
            self.fitted.emit(order, answer)
