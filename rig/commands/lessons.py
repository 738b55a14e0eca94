"""What the runs of a bench teach of it: its output encoder, its torque scale; shown, told to a script, and written."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Protocol

from rig.commands.terminal import console, echo, painted


class _Lesson(Protocol):
    """What the runs of one protocol teach: to be shown, told to a script, and written."""

    bench: str
    prefix: str
    suffix: str
    is_certificate: bool

    def show(self, path: Path | None) -> None: ...

    def as_json(self) -> dict[str, object]: ...

    def write(self, path: Path, today: date, due: date) -> Path: ...


class _EncoderLesson:
    """The output encoder, by kinematic-error runs."""

    suffix = ".csv"

    def __init__(self, runs: list[Path], bench_id: str) -> None:
        from rig.analysis.learnt import PREFIX
        from rig.analysis.learnt_encoder import learn as learn_from

        self.prefix = PREFIX
        self._learnt = learn_from(runs, bench_id)
        self.bench, self.is_certificate = self._learnt.bench, self._learnt.curve.is_parted

    def show(self, path: Path | None) -> None:
        from model.units import ARCSEC
        from rig.content.grid import Grid, columns, number_columns
        from rig.content.wording import number

        learnt, curve = self._learnt, self._learnt.curve
        rows = [
            (
                f"{one.order}/N",
                number(abs(one.wave) / ARCSEC, 3),
                number(one.radius / ARCSEC, 2),
                number(one.gears / ARCSEC, 2),
                "" if one.way == "parted" else "mean: encoder and what gears share",
            )
            for one in curve.orders
        ]
        heads = number_columns("order", "encoder [arcsec]", "U", "gears differ by")
        grid = Grid(
            f"Output encoder of bench {learnt.bench}: {curve.basis}",
            (*heads, *columns(("remark", "sentence"))),
            rows,
            "U: 95 % of the errors of the complex amplitude are no longer. Orders above 8 and the subdivision stay.",
        )
        console().print(painted(grid.without_empty()))
        echo(
            f"{len(curve.gears)} gear{'s' * (len(curve.gears) > 1)} in {curve.mountings} mountings; U of the curve "
            f"{number(curve.expanded_uncertainty / ARCSEC, 2)} arcsec. Not traceable: no laboratory vouches for it."
        )
        for one in learnt.skipped:
            echo(f"left out: {one.run.name}: {one.skipped}")
        _say_written(path, self.prefix)

    def as_json(self) -> dict[str, object]:
        learnt, curve = self._learnt, self._learnt.curve
        return {
            "of": "output encoder",
            "bench": learnt.bench,
            "encoder": learnt.encoder,
            "origin": learnt.origin,
            "basis": curve.basis,
            "gears": list(curve.gears),
            "mountings": curve.mountings,
            "expanded_uncertainty": curve.expanded_uncertainty,
            "orders": [
                {
                    "order": one.order,
                    "cosine": one.wave.real,
                    "sine": one.wave.imag,
                    "standard_uncertainty": one.standard_uncertainty,
                    "degrees_of_freedom": one.degrees_of_freedom,
                    "radius": one.radius,
                    "way": one.way,
                    "gears": one.gears,
                }
                for one in curve.orders
            ],
            "left_out": [{"run": one.run.name, "reason": one.skipped} for one in learnt.skipped],
        }

    def write(self, path: Path, today: date, due: date) -> Path:
        from rig.analysis.learnt_encoder import write_learnt

        return write_learnt(self._learnt, path, today, due)


class _TorqueLesson:
    """The scale of the torque channels, by torque-scale runs."""

    suffix = ".toml"
    is_certificate = True

    def __init__(self, runs: list[Path], bench_id: str) -> None:
        from rig.analysis.learnt import SCALE_PREFIX
        from rig.analysis.learnt_torque import learn_torque

        self.prefix = SCALE_PREFIX
        self._learnt = learn_torque(runs, bench_id)
        self.bench = self._learnt.bench

    def show(self, path: Path | None) -> None:
        from rig.content.grid import Grid, columns
        from rig.content.wording import number

        learnt = self._learnt
        rows = [
            (
                name,
                number(gain.value, 5),
                number(100.0 * gain.expanded_uncertainty / gain.value, 2),
                number(1e3 * learnt.lags[name][0], 2) if name in learnt.lags else "",
                max(gain.budget, key=lambda line: line.standard_uncertainty).source,
            )
            for name, gain in learnt.gains.items()
        ]
        heads = columns(
            "channel",
            ("gain", "number"),
            ("U [%]", "number"),
            ("lag [ms]", "number"),
            "largest part of U",
        )
        at = f" at {learnt.temperature:.1f} °C" if math.isfinite(learnt.temperature) else ""
        grid = Grid(f"Torque scale of bench {learnt.bench}{at}", heads, rows)
        console().print(painted(grid.without_empty()))
        echo(
            f"from {'; '.join(learnt.discs)}; the rotor has {number(1e4 * learnt.rotor_inertia, 4)} kg cm2"
        )
        for one in learnt.skipped:
            echo(f"left out: {one.run.name}: {one.skipped}")
        _say_written(path, self.prefix)

    def as_json(self) -> dict[str, object]:
        learnt = self._learnt
        return {
            "of": "torque scale",
            "bench": learnt.bench,
            "origin": learnt.origin,
            "motor": learnt.motor,
            "housing_temperature": learnt.temperature,
            "rotor_inertia": learnt.rotor_inertia,
            "gains": {name: gain.as_json() for name, gain in learnt.gains.items()},
            "lags": {name: {"value": v, "u": u} for name, (v, u) in learnt.lags.items()},
            "left_out": [{"run": one.run.name, "reason": one.skipped} for one in learnt.skipped],
        }

    def write(self, path: Path, today: date, due: date) -> Path:
        from rig.analysis.learnt_torque import write_scale

        return write_scale(self._learnt, path, today, due)


LESSONS: dict[str, Callable[[list[Path], str], _Lesson]] = {
    "kinematic-error": _EncoderLesson,
    "torque-scale": _TorqueLesson,
}
"""By the protocol whose runs teach it."""


def _say_written(path: Path | None, prefix: str) -> None:
    if path is None:
        return
    echo(f"file         {path}")
    if path.name.startswith(prefix):
        echo(f"next         rig fit RUN of {path.parent}: every analysis takes it")
    else:
        echo(f"next         lay it beside the runs as {prefix}...: there every analysis takes it")
