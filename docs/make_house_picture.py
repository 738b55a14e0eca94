"""The picture of the house: floors and layers as the contracts of `pyproject.toml` say them.

python docs/make_house_picture.py        # into docs/screenshots/house.png
"""

from __future__ import annotations

import io
import json
import tomllib
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from PIL import Image

HERE = Path(__file__).resolve().parent
PICTURE = HERE / "screenshots" / "house.png"
WIDTH, HEIGHT, GAP = 6.4, 0.34, 0.06
"""Inches: of the picture, of one row, between rows and boxes."""
PAPER, FLOOR, ROOM, INK, QUIET = "white", "#d9e4f1", "#f3f6fa", "#1d2733", "#5b6775"
FLOORS, APPLICATION = "floors", "application"


def layers() -> dict[str, list[list[str]]]:
    """Each layer's names, the highest first: of the floors, and of the application."""
    project = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))
    contracts: dict[str, Any] = {c["id"]: c for c in project["tool"]["importlinter"]["contracts"]}
    return {
        which: [
            [name.strip() for name in layer.replace("|", ":").split(":")]
            for layer in contracts[which]["layers"]
        ]
        for which in (FLOORS, APPLICATION)
    }


def picture(told: dict[str, list[list[str]]]) -> bytes:
    """Rows of boxes: the rooms of `rig` inside of their floor, the other floors below it."""
    rooms, floors = told[APPLICATION], told[FLOORS]
    inside = len(rooms) * (HEIGHT + GAP) + HEIGHT + GAP
    below = (len(floors) - 1) * (HEIGHT + GAP)
    total = inside + below + HEIGHT
    figure = Figure(figsize=(WIDTH, total), facecolor=PAPER)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, WIDTH), ylim=(0.0, total))
    axes.axis("off")

    def box(left: float, bottom: float, width: float, height: float, colour: str) -> None:
        axes.add_patch(
            FancyBboxPatch(
                (left, bottom), width, height, "round,pad=0,rounding_size=0.05",
                facecolor=colour, edgecolor=QUIET, linewidth=0.6,
            )
        )  # fmt: skip

    def row(names: list[str], bottom: float, left: float, right: float, colour: str) -> None:
        share = (right - left - (len(names) - 1) * GAP) / len(names)
        for place, name in enumerate(names):
            start = left + place * (share + GAP)
            box(start, bottom, share, HEIGHT, colour)
            axes.text(
                start + share / 2, bottom + HEIGHT / 2, name,
                ha="center", va="center", fontsize=8.5, color=INK,
            )  # fmt: skip

    edge = 0.1
    box(edge, total - inside - edge, WIDTH - 2 * edge, inside, FLOOR)
    axes.text(2 * edge, total - edge - HEIGHT / 2, "rig", va="center", fontsize=9.5, color=INK)
    axes.text(
        WIDTH - 2 * edge, total - edge - HEIGHT / 2, "each imports only what stands below it",
        ha="right", va="center", fontsize=8, color=QUIET,
    )  # fmt: skip
    for place, names in enumerate(rooms, start=1):
        bottom = total - edge - place * (HEIGHT + GAP) - HEIGHT + GAP / 2
        row(names, bottom, 2 * edge, WIDTH - 2 * edge, ROOM)
    for place, names in enumerate(floors[1:], start=1):
        row(names, total - edge - inside - place * (HEIGHT + GAP), edge, WIDTH - edge, FLOOR)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=180, metadata={"Description": json.dumps(told)})
    return file.getvalue()


def shown() -> dict[str, list[list[str]]]:
    """What the kept picture was made from."""
    with Image.open(PICTURE) as kept:
        return json.loads(kept.info["Description"])


if __name__ == "__main__":
    PICTURE.write_bytes(picture(layers()))
