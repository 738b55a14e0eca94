"""Which gears of a lot the page shows, and what of a quantity that leaves."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from rig.fleet.lot import Lot, LotGear
from rig.fleet.lot_quantity import LotQuantity
from rig.fleet.lot_rows import LotRow


@dataclass(frozen=True)
class WantedGears:
    """What the filter lets pass: every word of `text` in serial number, bench or reasons; bench and verdict exactly."""

    text: str = ""
    bench: str = ""
    verdict: str = ""

    def of(self, lot: Lot) -> tuple[LotGear, ...]:
        """The gears that are wanted, in the order of their serial numbers."""
        return tuple(gear for gear in lot.gears if self._passes(gear))

    def _passes(self, gear: LotGear) -> bool:
        if self.verdict and gear.verdict != self.verdict:
            return False
        if self.bench and self.bench not in gear.bench.split(", "):
            return False
        hay = " ".join((gear.gear, gear.bench, *gear.because, *gear.unlike)).casefold()
        return all(word in hay for word in self.text.casefold().split())


def of_gears(one: LotQuantity, gears: Collection[str]) -> LotQuantity:
    """A quantity over some gears of its lot alone."""
    return replace(one, rows=tuple(row for row in one.rows if row.gear in gears))


def pairs_of(x: LotQuantity, y: LotQuantity) -> list[tuple[LotRow, LotRow]]:
    """Gears for which both quantities were measured: the row of each."""
    of_y = {row.gear: row for row in y.measured}
    return [(row, of_y[row.gear]) for row in x.measured if row.gear in of_y]
