"""What a laboratory wants of alarms: the `[alarms]` of its rig's description."""

from __future__ import annotations

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
    written = None
    if path is not None:
        # Text is checked by pydantic, which a passport without a description does without.
        from rig.bench.config.load import load_alarms

        written = load_alarms(path)
    usual = Promise()
    here = (
        usual if written is None else Promise(written.false_alarms, written.over, written.baseline)
    )
    promise = Promise(
        here.false_alarms if false_alarms is None else false_alarms,
        here.over if over is None else over,
        here.baseline if baseline is None else baseline,
    )
    if written is None:
        return Watching(promise)
    return Watching(promise, written.golden_gear, written.golden_days)
