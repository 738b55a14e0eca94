"""The colours of the window, light and dark: surfaces, text, states, and the series of plots.

Series are the Okabe-Ito colours, which people with every kind of colour vision can tell apart; the
two that vanish on a background (yellow on white, black on black) are darkened or lightened there. A
colour never carries a meaning alone: states have a word and a symbol, series a name and a line
style.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Palette:
    """The colours of one theme (CSS hex). `series` is for curves, in order."""

    name: str
    window: str
    surface: str
    raised: str
    text: str
    muted: str
    line: str
    accent: str
    accent_text: str
    good: str
    warning: str
    bad: str
    stop: str
    stop_text: str
    series: tuple[str, ...]

    def series_colour(self, index: int) -> str:
        """The colour of the n-th series; after the last it begins again."""
        return self.series[index % len(self.series)]


LIGHT = Palette(
    name="light",
    window="#f3f4f6",
    surface="#ffffff",
    raised="#e6e8ec",
    text="#16191d",
    muted="#565d66",
    line="#c3c8cf",
    accent="#0072b2",
    accent_text="#ffffff",
    good="#007a5a",
    warning="#9a5b00",
    bad="#b3261e",
    stop="#c62218",
    stop_text="#ffffff",
    series=("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#16191d", "#a39a00"),
)
DARK = Palette(
    name="dark",
    window="#15181c",
    surface="#1d2126",
    raised="#2a2f36",
    text="#eceff2",
    muted="#a4acb6",
    line="#454c56",
    accent="#56b4e9",
    accent_text="#0c1116",
    good="#3fc79a",
    warning="#e69f00",
    bad="#ff8a7a",
    stop="#d6352a",
    stop_text="#ffffff",
    series=("#56b4e9", "#e69f00", "#2fc79a", "#e29ac3", "#3d8fd1", "#f07b2e", "#eceff2", "#f0e442"),
)
_PALETTES = {palette.name: palette for palette in (LIGHT, DARK)}
"""Every theme by its name."""


def palette_of(theme: str) -> Palette:
    """The colours of a theme; an unknown name is the light one."""
    return _PALETTES.get(theme, LIGHT)
