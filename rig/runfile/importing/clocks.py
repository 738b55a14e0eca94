"""Times as foreign files have them, as nanoseconds: numbers in any unit, ticks, dates in ISO 8601."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

FILETIME_1970 = 116_444_736_000_000_000
"""1970-01-01 in ticks of 100 ns since 1601-01-01, as Windows and PLCs count them."""
FILETIME_TICKS = 100
"""Nanoseconds of such a tick."""
_FRACTION = re.compile(r"(.*\d\d:\d\d:\d\d)[.,](\d+)(.*)")
LATEST_S = 9.2e9
"""Seconds that a time in nanoseconds has room for."""


def in_zone(moment: datetime) -> datetime:
    """A moment with its zone: UTC where it has none."""
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def is_date(text: str) -> bool:
    """Whether a text, in quotes or not, is a date and time in ISO 8601."""
    try:
        TextClock(is_filetime=False).read(text.strip("'"))
    except ValueError:
        return False
    return True


@dataclass
class NumberClock:
    """A column of numbers, `factor` seconds each; `modulus` is the range after which the counter wraps (0: never).

    `origin_ns`: where its zero lies in the times of the run.
    """

    factor: float
    modulus: float = 0.0
    origin_ns: int = 0
    _turns: float = 0.0
    _last: float = np.nan

    def seconds(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Seconds of a column of values, unwrapped where the counter wraps."""
        if self.modulus and len(values):
            before = values[0] if np.isnan(self._last) else self._last
            # A clock only goes on: a smaller number is the next turn.
            turns = self._turns + np.cumsum(np.diff(values, prepend=before) < -0.5 * self.modulus)
            self._turns, self._last = float(turns[-1]), float(values[-1])
            values = values + turns * self.modulus
        return values * self.factor

    def nanoseconds(self, seconds: NDArray[np.float64]) -> NDArray[np.int64]:
        """Whole seconds and the rest apart: their product with 1e9 has no room for both in calendar times."""
        whole = np.floor(seconds)
        rest = np.rint((seconds - whole) * 1e9).astype(np.int64)
        return whole.astype(np.int64) * 1_000_000_000 + rest + self.origin_ns


@dataclass
class TextClock:
    """A column of dates or of long tick counts, read exactly: seconds since the first one, which is kept in ns.

    `is_filetime`: ticks of 100 ns since 1601; else ISO 8601, UTC where no zone is given.
    """

    is_filetime: bool
    origin_ns: int | None = None

    def read(self, text: str) -> float:
        """The text of a cell as nanoseconds since the first one; `ValueError` with why it is none."""
        calendar_ns = self._calendar_ns(text)
        if self.origin_ns is None:
            self.origin_ns = calendar_ns
        return float(calendar_ns - self.origin_ns)

    def _calendar_ns(self, text: str) -> int:
        if self.is_filetime:
            if not text.isdigit():
                raise ValueError("not a count of ticks since 1601")
            return (int(text) - FILETIME_1970) * FILETIME_TICKS
        match = _FRACTION.fullmatch(text)
        whole, fraction = (match[1] + match[3], match[2]) if match else (text, "0")
        try:
            moment = datetime.fromisoformat(whole)
        except ValueError:
            raise ValueError("not a date and time in ISO 8601") from None
        since = in_zone(moment) - datetime(1970, 1, 1, tzinfo=UTC)
        return (since.days * 86_400 + since.seconds) * 1_000_000_000 + int(
            fraction[:9].ljust(9, "0")
        )

    def seconds(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Seconds since the first time."""
        return values * 1e-9

    def nanoseconds(self, seconds: NDArray[np.float64]) -> NDArray[np.int64]:
        """Calendar nanoseconds."""
        return np.rint(seconds * 1e9).astype(np.int64) + (self.origin_ns or 0)
