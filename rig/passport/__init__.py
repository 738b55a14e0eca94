"""The passport of a gear: its runs over time as control charts, from the analyses that lie beside the runs.

`content.py` says what a passport holds, `build.py` makes one; `quantities.py` is the table of what
is followed, `chart.py` the individuals chart, `gather.py` the way from run files to points,
`draw.py` the figures, `analyse.py` fits what is not fitted yet.
"""

from rig.passport.analyse import Analysed, analyse_runs
from rig.passport.build import passport
from rig.passport.content import (
    CatalogueLimit,
    ControlLimits,
    Missing,
    Passport,
    PassportPoint,
    PassportSeries,
)

__all__ = [
    "Analysed",
    "CatalogueLimit",
    "ControlLimits",
    "Missing",
    "Passport",
    "PassportPoint",
    "PassportSeries",
    "analyse_runs",
    "passport",
]
