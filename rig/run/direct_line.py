"""What is asked of the devices beside the cyclic data while the rig is made safe, by how each of them can be reached.

The process data carry the same controlword in every cycle, whoever hears them: a SYNC or an NMT START that comes back
finds the stop there, and enables nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from drivers.channel import STATUSWORD
from drivers.port import Ask, DirectLine, Mode, Reach, Request

STOP: Final[Mapping[Mode, Ask]] = {Mode.QUICK_STOP: Ask.QUICK_STOP, Mode.OFF: Ask.SERVO_OFF}
"""What the drive is told in each mode that stops it; nothing else is ever told it here."""


def requests_for(
    line: DirectLine, observer: str, mode: Mode, *, insists: bool = False
) -> list[Request]:
    """What is asked next of the device that carries an observer, the drive being stopped in `mode`.

    `insists`: its process data are heard, and it was not seen to obey them.
    """
    stop = [STOP[mode]] if observer == STATUSWORD and mode in STOP else []
    asked: Mapping[Reach, Sequence[Ask]] = {
        Reach.PROCESS_DATA: stop if insists else [],
        Reach.SDO: [*stop, Ask.READ],
        Reach.NMT_FIRST: [Ask.WAKE, *stop, Ask.READ],
    }
    return [Request(ask, observer) for ask in asked[line.reach(observer)]]
