"""What a laboratory wants of alarms: the `[alarms]` of its rig's description."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rig.analysis.alarm.promise import Promise, Watching
from rig.bench.config.place import DEFAULT_PATH


def watching_in_force(
    config: Path | None = None,
    *,
    false_alarms: float | None = None,
    over: int | None = None,
    baseline: int | None = None,
) -> Watching:
    """The promise and the golden gear of `config`, or of `rig.toml` in the present folder where there is one; what is
    said here goes before it. Raises `ConfigurationError` for a table that cannot be accepted, `RigError` for a promise
    that no threshold can be drawn for.
    """
    path = config or (DEFAULT_PATH if DEFAULT_PATH.is_file() else None)
    watching = Watching()
    if path is not None:
        # Text is checked by pydantic, which a passport without a description does without.
        from rig.bench.config.load import load_alarms

        if (written := load_alarms(path)) is not None:
            promise = Promise(written.false_alarms, written.over, written.baseline)
            watching = Watching(promise, written.golden_gear, written.golden_days)
    asked = {"false_alarms": false_alarms, "over": over, "baseline": baseline}
    said = {name: value for name, value in asked.items() if value is not None}
    return replace(watching, promise=replace(watching.promise, **said))
