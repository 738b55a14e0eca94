"""`rig.gear`: the parameter set of a gear, by its file, its name, or its part number."""

from __future__ import annotations

from pathlib import Path

from model.catalogue.proportions import gear_of_product
from model.catalogue.table import read_product
from model.gear import HarmonicDrive
from model.gear_file import load_gear, shipped_gear

SHIPPED = "csf-25-120"
_UNIT_TYPE_PLACE = 3
"""The hyphen of a part number behind which its unit type stands: SHG-32-100-2UH."""


def gear(name: str | Path | HarmonicDrive = SHIPPED) -> HarmonicDrive:
    """A parameter set: the one that ships ("csf-25-120"), a TOML file, or a maker's part number ("SHG-32-100-2UH").

    Of a part number the values come from makers' tables where these have it; the rest is scaled and marked as
    assumed in its origins. `.with_values({"inertia.output": 0.01})` gives a changed copy.
    Raises `ParameterError` for a file that cannot be read and for a part that is not known.
    """
    if isinstance(name, HarmonicDrive):
        return name
    text = str(name)
    if text.lower().endswith(".toml"):
        return load_gear(text)
    # Part numbers end with a unit type; what ships is named without one.
    if text.count("-") >= _UNIT_TYPE_PLACE:
        return gear_of_product(read_product(text), {})
    return shipped_gear(text)
