"""What a target makes of an exported file: simulated there, and held against equation 20 and the gear's inertia.

MuJoCo reads MJCF and URDF alike (`mujoco`, extra `export`). JSON is read by its own equations alone.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from model.friction import friction_torque
from model.units import RPM
from rig.content.grid import Grid, columns, number_columns
from rig.content.wording import number
from rig.exchange.gear_json import torque_of
from rig.exchange.identified import IdentifiedGear
from rig.exchange.joint import Joint, torque_at
from rig.extras import optional

_AT_RPM = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 2000.0, 3000.0)
"""Input speeds [r/min] at which the target is asked, as far as they lie among the compared ones."""
STEADY_RPM = (300.0, 1000.0, 3000.0)
"""Input speeds [r/min] whose torque the target is given, until its speed is steady. Below them friction falls with
speed, and no steady speed exists.
"""
_SETTLE, _CONSTANTS = 4000, 12.0
"""Steps at a held speed until the bristles are bent; time constants until a speed is steady."""
_PROPORTIONAL, _INTEGRAL = 0.2, 0.01
"""Gains of the servo that holds a speed, over inertia over time step."""


@dataclass(frozen=True)
class Row:
    """One thing that was simulated in the target, `found` there and `expected` here, both in `unit`."""

    what: str
    found: float
    expected: float
    unit: str

    @property
    def error(self) -> float:
        """Relative difference."""
        return self.found / self.expected - 1.0

    def as_json(self) -> dict[str, Any]:
        """As `--json` prints it."""
        return {
            "what": self.what,
            "found": self.found,
            "expected": self.expected,
            "unit": self.unit,
            "relative_error": self.error,
        }


def check_grid(rows: tuple[Row, ...], target: str) -> Grid:
    """The rows as a table."""
    heads = (
        *columns("simulated"),
        *number_columns("there", "here"),
        *columns(("unit", "unit")),
        *number_columns("error [%]"),
    )
    cells = [
        (
            one.what,
            number(one.found, 4),
            number(one.expected, 4),
            one.unit,
            f"{100 * one.error:+.2f}",
        )
        for one in rows
    ]
    return Grid(f"Checked in {target}", heads, cells)


def check_json(identified: IdentifiedGear, text: str) -> tuple[Row, ...]:
    """The file read back, its torque by its own equations."""
    content = json.loads(text)
    return tuple(
        Row(
            f"friction at {speed / RPM:.4g} r/min",
            torque_of(content, speed),
            float(friction_torque(identified.gear, speed)),
            "N m",
        )
        for speed in _speeds(identified)
    )


def check_in_mujoco(identified: IdentifiedGear, joint: Joint, text: str) -> tuple[Row, ...]:
    """Friction at held speeds, the speed at which a torque is steady, and the inertia, by MuJoCo. Raises `RigError`
    where it is not installed.
    """
    mujoco: Any = optional("mujoco", "simulating in MuJoCo", "export")
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.gravity[:] = 0.0
    return tuple(_rows(mujoco, model, identified, joint))


def _rows(mujoco: Any, model: Any, identified: IdentifiedGear, joint: Joint) -> Iterator[Row]:
    holds_inertia = float(model.dof_armature[0]) > 0.0
    if not holds_inertia:
        # URDF has no armature: whoever simulates the joint gives it one.
        model.dof_armature[0] = joint.inertia
        mujoco.mj_setConst(model, mujoco.MjData(model))
    for speed in _speeds(identified):
        here = float(torque_at(identified, joint.side, speed / joint.factor))
        there = _holding_torque(mujoco, model, speed / joint.factor, joint.inertia)
        yield Row(f"friction at {speed / RPM:.4g} r/min", there, here, "N m")
    yield from _steady(mujoco, model, identified, joint)
    if holds_inertia:
        yield Row("inertia", _inertia(mujoco, model), joint.inertia, "kg m2")


def _speeds(identified: IdentifiedGear) -> list[float]:
    low, high = identified.compared_over
    return [rpm * RPM for rpm in _AT_RPM if 0.999 * low <= rpm * RPM <= 1.001 * high]


def _holding_torque(mujoco: Any, model: Any, speed: float, inertia: float) -> float:
    """Torque that a servo of the target needs to keep a speed [N m], once it is steady.

    Not the target's own list of forces at that speed: its dry friction is a constraint, which answers to a torque.
    """
    data = mujoco.MjData(model)
    data.qvel[0] = speed
    gain, kept, torques = inertia / model.opt.timestep, 0.0, []
    for _ in range(_SETTLE):
        away = speed - float(data.qvel[0])
        kept += _INTEGRAL * gain * away
        data.qfrc_applied[0] = kept + _PROPORTIONAL * gain * away
        torques.append(float(data.qfrc_applied[0]))
        mujoco.mj_step(model, data)
    return float(np.mean(torques[-_SETTLE // 4 :]))


def _steady(mujoco: Any, model: Any, identified: IdentifiedGear, joint: Joint) -> Iterator[Row]:
    """The speeds that become steady where the torque of equation 20 is applied."""
    for rpm in STEADY_RPM:
        speed = rpm * RPM / joint.factor
        if rpm * RPM > 1.001 * identified.compared_over[1]:
            continue
        torque = float(torque_at(identified, joint.side, speed))
        slope = float(torque_at(identified, joint.side, 1.05 * speed) - torque) / (0.05 * speed)
        data = mujoco.MjData(model)
        data.qvel[0], data.qfrc_applied[0] = speed, torque
        steps = round(_CONSTANTS * joint.inertia / slope / model.opt.timestep)
        mujoco.mj_step(model, data, nstep=steps)
        yield Row(f"steady speed at {torque:.4g} N m", float(data.qvel[0]), speed, "rad/s")


def _inertia(mujoco: Any, model: Any) -> float:
    """Torque over acceleration at rest, by the difference of two torques far above friction [kg m2]."""
    found = []
    torques = np.array([1e6, 2e6]) * max(float(model.dof_armature[0]), 1e-9)
    for torque in torques:
        data = mujoco.MjData(model)
        data.qfrc_applied[0] = torque
        mujoco.mj_forward(model, data)
        found.append(float(data.qacc[0]))
    return float((torques[1] - torques[0]) / (found[1] - found[0]))
