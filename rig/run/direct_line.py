"""A line to each device beside the cyclic data: asked and switched off one by one, where the cyclic data stay away."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from drivers.port import AnswersDirectly, RigPort


class DirectLine:
    """A line to each device beside the cyclic data, for making safe a rig whose cyclic data stay away.

    `rest` is called before every question: who watches the turns must not take a slow answer for a dead loop.
    """

    def __init__(self, port: AnswersDirectly, rest: Callable[[], None] = lambda: None) -> None:
        self._port, self._rest = port, rest

    def ask(self, channels: Sequence[str]) -> dict[str, int]:
        """Raw counts of those of the channels whose devices answer."""
        self._rest()
        return self._port.ask(channels)

    def switch_off(self) -> None:
        """Servo off by a command to the drive alone."""
        self._rest()
        self._port.switch_off()


def direct_line(port: RigPort, rest: Callable[[], None] = lambda: None) -> DirectLine | None:
    """The direct line of a rig that has one."""
    return DirectLine(port, rest) if isinstance(port, AnswersDirectly) else None
