"""Logs in JSON: a list of objects with the same keys, one per sample, alone or under a key of the file."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from rig.errors import RunFileError
from rig.runfile.importing.adapters.arrays import ArrayTable

SHOWN = 8


def json_table(path: Path) -> ArrayTable:
    """The columns of a log: the longest list of objects in the file. Truth values become 0 and 1.

    A key that an object lacks, or that has no number there, is a hole (NaN). What else stands at
    the top of the file is shown in a note.
    """
    try:
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise RunFileError(f"cannot be read: {error.strerror or error}", where=str(path)) from error
    except (ValueError, RecursionError) as error:
        raise RunFileError(f"is not JSON: {error}", where=str(path)) from error
    entries = _samples(content)
    names = list(dict.fromkeys(key for entry in entries for key in entry))
    arrays = {name: np.array([_number(entry.get(name)) for entry in entries]) for name in names}
    table = ArrayTable(
        path, {name: a for name, a in arrays.items() if np.isfinite(a).any()}, "JSON log"
    )
    if isinstance(content, dict):
        stated = {k: v for k, v in content.items() if isinstance(v, (str, int, float))}
        said = ", ".join(f"{key} {value}" for key, value in list(stated.items())[:SHOWN])
        table.notes += (f"the file says: {said}",) if said else ()
    return table


def _samples(content: Any) -> list[dict[str, Any]]:
    """The longest list of objects; empty where there is none."""
    lists = content.values() if isinstance(content, dict) else [content]
    found = [
        x
        for x in lists
        if isinstance(x, list) and x and all(isinstance(entry, dict) for entry in x)
    ]
    return max(found, key=len, default=[])


def _number(value: Any) -> float:
    return float(value) if isinstance(value, (int, float)) else math.nan
