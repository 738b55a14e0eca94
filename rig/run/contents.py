"""Parameters that are the content of a file: where a path is said the file is read, and the run carries it whole."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments.errors import PlanError
from experiments.parameters import parameter_fields
from rig.errors import RunFileError
from rig.runfile.sealed import read_sealed


def with_contents(model: type[Any], values: Mapping[str, Any], where: str = "") -> dict[str, Any]:
    """The values with the content of a file in the place of its path; a content, which has lines, is left as it is.

    The file is held against its seal. Raises `PlanError` for one that cannot be read or was altered.
    """
    read = dict(values)
    for one in parameter_fields(model):
        value = read.get(one.name)
        if not one.content or not isinstance(value, str) or not value or "\n" in value:
            continue
        try:
            data, _ = read_sealed(Path(value).expanduser())
            read[one.name] = data.decode()
        except (RunFileError, UnicodeDecodeError) as error:
            raise PlanError(
                "cannot be taken",
                where=f"{where}.{one.name}",
                value=str(error),
                limit=f"a sealed {one.content} file",
            ) from error
    return read
