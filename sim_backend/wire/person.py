"""Somebody who stands at a simulated bench and does with the hands what a question asks for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from sim_backend.wire.faults import HubGone

if TYPE_CHECKING:
    from sim_backend.wire.bench import WireBench

TURNS = 10.0
"""Turns of the input shaft by hand."""


class Person:
    """Acts by the key of a question; the answer is what such a person would type, "" where the act is the answer."""

    def __init__(self, bench: WireBench) -> None:
        self._bench = bench
        self._acts: Mapping[str, Callable[[], str]] = {
            "press-emergency-stop": lambda: self._cut_off(True),
            "release-emergency-stop": lambda: self._cut_off(False),
            "open-guard": lambda: self._guard(True),
            "close-guard": lambda: self._guard(False),
            "turn-shaft": self._turn,
            "unplug": self._unplug,
        }

    def act(self, key: str) -> str:
        """Do what a key asks for; a key that asks for nothing is answered by "" as well."""
        act = self._acts.get(key)
        return act() if act is not None else ""

    def _cut_off(self, is_off: bool) -> str:
        self._bench.drive.safe_torque_off(is_off)
        return ""

    def _guard(self, is_open: bool) -> str:
        self._bench.drive.open_guard(is_open)
        return ""

    def _turn(self) -> str:
        self._bench.turn_by_hand(TURNS)
        return f"{TURNS:g}"

    def _unplug(self) -> str:
        self._bench.inject(HubGone(self._bench.cycle))
        return ""
