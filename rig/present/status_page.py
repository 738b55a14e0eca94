"""A run on one self-contained page, for a phone and a wall: state word, four numbers, one picture, its own age.

The page reloads itself and counts how long ago it was written: one that nobody writes any more says so by itself, on
whatever share or server it lies. Nothing but Python's own library is imported: the process that paints it stands
beside a motor that turns.
"""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from typing import Any

EVERY = 2.0
"""s between two writings, and between two readings of the page."""
OLD = 10.0
"""s after which a page of a run that is not over has no news."""
COLOURS = {
    "running": "#1f6f43",
    "waiting for you": "#8a6100",
    "stopping": "#8a6100",
    "tripped": "#a3271f",
    "lost": "#a3271f",
    "refused": "#a3271f",
}
"""Of the state word's ground; the word itself says the same."""
_WIDTH, _HEIGHT, _MARGIN = 640, 220, 34

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="refresh" content="{every:g}"><title>{word}: {title}</title><style>
body {{ margin: 0; font: 18px/1.4 system-ui, sans-serif; color: #1c2733; background: #f5f6f7 }}
header {{ padding: 1.2rem; color: #fff; background: {colour} }}
h1 {{ margin: 0; font-size: 2.6rem; text-transform: uppercase }}
header p, footer {{ margin: .3rem 0 0 }}
dl {{ display: grid; grid-template-columns: repeat(auto-fit, minmax(9rem, 1fr)); gap: 1rem; margin: 1.2rem }}
dt {{ font-size: .85rem; color: #56636f }} dd {{ margin: 0; font-size: 1.5rem }}
svg {{ display: block; width: calc(100% - 2.4rem); margin: 0 1.2rem; background: #fff }}
footer {{ padding: 0 1.2rem 1.2rem; font-size: .9rem; color: #56636f }} .old {{ color: #a3271f; font-weight: bold }}
</style></head><body>
<header><h1>{word}</h1><p>{title}</p><p>{what}</p></header>
<dl>{numbers}</dl>
{picture}
<footer>written {written}, <span id="age" data-at="{at}" data-old="{old}"></span></footer>
<script>
const age = document.getElementById("age");
function tell() {{
  const s = Math.max(0, Math.round(Date.now() / 1000 - age.dataset.at));
  const old = age.dataset.old && s > age.dataset.old;
  age.textContent = old ? "NO NEWS FOR " + s + " s: the run's computer, or the way to it, is gone" : s + " s ago";
  age.className = old ? "old" : "";
  if (old) {{
    document.querySelector("h1").textContent = "no news";
    document.querySelector("header").style.background = "{bad}";
  }}
}}
tell(); setInterval(tell, 1000);
</script></body></html>
"""


def painted(
    told: Mapping[str, Any], course: Sequence[tuple[float, float]], at: float, written: str
) -> str:
    """The page of what was told last, with the course of the speed: points of time [s] and r/min.

    `at` is the calendar time [s] at which it is `written`, as text too.
    """
    word = str(told.get("state", ""))
    numbers = "".join(
        f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(str(value))}</dd></div>"
        for name, value in told.get("numbers", {}).items()
    )
    words = " ".join(str(told.get(key, "")) for key in ("what", "remedy"))
    return _PAGE.format(
        every=EVERY,
        word=html.escape(word),
        title=html.escape(str(told.get("title", ""))),
        what=html.escape(words.strip()),
        colour=COLOURS.get(word, "#33475b"),
        numbers=numbers,
        picture=_picture(course),
        written=html.escape(written),
        at=f"{at:.0f}",
        old="" if told.get("over") else f"{OLD:g}",
        bad=COLOURS["lost"],
    )


def _picture(course: Sequence[tuple[float, float]]) -> str:
    """Speed over time as a picture; nothing for less than two points."""
    if len(course) < 2:
        return ""
    first, last = course[0][0], course[-1][0]
    low = min(0.0, *(speed for _, speed in course))
    high = max(0.0, *(speed for _, speed in course))
    if last <= first or high <= low or not math.isfinite(high - low):
        return ""
    wide, tall = _WIDTH - 2 * _MARGIN, _HEIGHT - 2 * _MARGIN

    def across(time: float) -> float:
        return _MARGIN + wide * (time - first) / (last - first)

    def down(speed: float) -> float:
        return _MARGIN + tall * (high - speed) / (high - low)

    line = " ".join(f"{across(time):.1f},{down(speed):.1f}" for time, speed in course)
    zero = f"{down(0.0):.1f}"
    top = f'<text x="{_MARGIN}" y="{_MARGIN - 10}">{high:.0f} r/min</text>' if high > 0.0 else ""
    bottom = f'<text x="{_MARGIN}" y="{_HEIGHT - 10}">{low:.0f} r/min</text>' if low < 0.0 else ""
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="input speed over time" font-size="15" '
        f'fill="#56636f"><path d="M{_MARGIN} {zero}H{_WIDTH - _MARGIN}" stroke="#c5ccd3"/>'
        f'<polyline points="{line}" fill="none" stroke="#1b5e9e" stroke-width="2"/>{top}{bottom}'
        f'<text x="{_WIDTH - _MARGIN}" y="{_HEIGHT - 10}" text-anchor="end">'
        f"input speed, {last - first:.0f} s</text></svg>"
    )
