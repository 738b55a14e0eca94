"""Whether the five packages are this program's own, asked before any of them is imported.

`rig`, `model`, `drivers`, `experiments` and `sim_backend` are plain words: a `model.py` beside a script, or another
distribution with a package `drivers`, stands in the way of ours. Then one sentence says which file it is.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

OURS = Path(__file__).parent.parent
"""The folder in which the five packages lie side by side."""
KNOWN_FILES = {
    "model": "gear.py",
    "drivers": "port.py",
    "experiments": "recording.py",
    "sim_backend": "world.py",
}
"""A module of each floor by which it is known."""
DISTRIBUTION = "harmonic-rig"


def foreign_floor() -> str:
    """A sentence on the first package that is not of this program; "" where all are."""
    # Another distribution that was installed after this one may have put its own `__init__` into our folder.
    if getattr(sys.modules.get("rig"), "DISTRIBUTION", "") != DISTRIBUTION:
        return _sentence("rig", str(OURS / "rig"))
    for name, known in KNOWN_FILES.items():
        place = _place_of(name)
        if place is None or place != OURS / name or not (place / known).is_file():
            return _sentence(name, str(place or "nowhere"))
    return ""


def refuse_foreign_floors() -> None:
    """Raise `ImportError` with that one sentence unless all packages are this program's own."""
    sentence = foreign_floor()
    if sentence:
        raise ImportError(sentence)


def _place_of(name: str) -> Path | None:
    """The folder of a package, or the file of a plain module, as an import would find it now; None for none."""
    try:
        spec = find_spec(name)
    except ValueError:
        # A module that somebody made by hand and that does not say where it came from.
        return Path(f"<module {name} in memory>")
    if spec is None or spec.origin is None:
        return None
    origin = Path(spec.origin)
    return origin.parent if spec.submodule_search_locations is not None else origin


def _sentence(name: str, found: str) -> str:
    return (
        f"`import {name}` finds {found}, which is not the package {name} of {DISTRIBUTION} in {OURS}: "
        f"rename or move that file, start elsewhere, or give {DISTRIBUTION} an environment of its own."
    )
