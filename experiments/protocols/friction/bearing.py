"""The bench's output bearing: what it adds to the friction that the input feels is not the gear's.

Referred to the input it is T = (T_b + c_b w/N)/N. No data of a run with the gear can tell it from the gear's dry
friction, so it is a property of the bench: measured with the gear off, dated, and subtracted with its uncertainty
(settings `output_bearing`, `output_bearing_viscous`, `output_bearing_date`, `output_bearing_source`); else the bench's
card says within which limits it lies.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from experiments.assumed import BEARING, Assumed
from experiments.protocols.friction.temperature import stated, value_and_u
from experiments.recording import Recording
from experiments.setting import OUTPUT_BEARING, names_of
from model.arrays import FloatArray
from model.identify.estimate import BudgetLine

CARD = "output_bearing"
"""Entry of a run's process record: what the bench's card says, `coulomb` [N m], `viscous` [N m s/rad], each with U."""
NAMES = names_of(OUTPUT_BEARING)
COULOMB, VISCOUS = "output bearing", "output bearing, viscous"
"""Its two lines in budgets."""


@dataclass(frozen=True, kw_only=True)
class OutputBearing:
    """Coulomb friction [N m] and viscous friction [N m s/rad] at the output, standard uncertainties, source.

    `is_subtracted`: a class alone says how much there may be, and takes nothing off.
    """

    coulomb: float
    coulomb_uncertainty: float
    viscous: float = 0.0
    viscous_uncertainty: float = 0.0
    source: str = ""
    is_subtracted: bool = True
    assumed: Assumed | None = None

    def torque(self, speed: FloatArray, ratio: float) -> FloatArray:
        """What is taken off the friction at input speeds [rad/s] [N m]."""
        on = float(self.is_subtracted)
        return on * (self.coulomb + self.viscous * np.abs(speed) / ratio) / ratio

    def effects(self, speed: FloatArray, ratio: float) -> dict[str, FloatArray]:
        """Change of the friction at the input for one standard uncertainty of each part [N m]."""
        return {
            COULOMB: np.full_like(speed, self.coulomb_uncertainty / ratio),
            VISCOUS: self.viscous_uncertainty * np.abs(speed) / ratio**2,
        }

    def line(self, source: str, size: float) -> BudgetLine:
        """A line of a budget, of this standard uncertainty."""
        if self.assumed is not None:
            return self.assumed.line(source, size)
        return BudgetLine(source, "B", size, self.words())

    def words(self) -> str:
        """What was done about it."""
        done = "subtracted" if self.is_subtracted else "not subtracted"
        return (
            f"{self.coulomb:.3g} ± {2.0 * self.coulomb_uncertainty:.2g} N m and {self.viscous:.3g} ± "
            f"{2.0 * self.viscous_uncertainty:.2g} N m s/rad at the output, {done} ({self.source})"
        )


UNKNOWN = OutputBearing(
    coulomb=0.0,
    coulomb_uncertainty=BEARING.standard_uncertainty,
    source=BEARING.note,
    is_subtracted=False,
    assumed=BEARING,
)


def output_bearing(recording: Recording, settings: Mapping[str, Any]) -> OutputBearing:
    """The bearing as entered, else by the bench's card in the run, else what is assumed."""
    if "output_bearing" in settings:
        coulomb, u_coulomb = value_and_u("output_bearing", settings["output_bearing"])
        viscous, u_viscous = 0.0, 0.0
        if "output_bearing_viscous" in settings:
            viscous, u_viscous = value_and_u(
                "output_bearing_viscous", settings["output_bearing_viscous"]
            )
        words = [
            stated(settings, "output_bearing", f"output_bearing_{companion}")
            for companion in ("source", "date")
        ]
        return OutputBearing(
            coulomb=coulomb,
            coulomb_uncertainty=0.5 * u_coulomb,
            viscous=viscous,
            viscous_uncertainty=0.5 * u_viscous,
            source=", ".join(words),
        )
    card = cast("Mapping[str, Any] | None", recording.metadata.process.get(CARD))
    if card is None:
        return UNKNOWN
    return OutputBearing(
        coulomb=float(card["coulomb"]),
        coulomb_uncertainty=0.5 * float(card["coulomb_u"]),
        viscous=float(card["viscous"]),
        viscous_uncertainty=0.5 * float(card["viscous_u"]),
        source=str(card["source"]),
    )
