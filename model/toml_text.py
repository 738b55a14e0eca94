"""Values as TOML has them, for files that the program writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast


def toml_value(value: object) -> str:
    """A text, a number, a date, a list or a table of these."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    if isinstance(value, Mapping):
        return (
            "{ "
            + ", ".join(
                f"{k} = {toml_value(v)}" for k, v in cast("Mapping[str, Any]", value).items()
            )
            + " }"
        )
    if isinstance(value, Sequence):
        return f"[{', '.join(map(toml_value, cast('Sequence[Any]', value)))}]"
    # Of a number as many digits as it has; a date is written as it is.
    return str(value)
