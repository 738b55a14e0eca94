"""The picture of a joint that coasts: by equation 20, and in MuJoCo by two of the exported laws of friction.

python docs/make_joint_picture.py        # into docs/screenshots/robot-joint.png (extra: export)
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

import harmonic_rig as rig
from rig.exchange.identified import identified_gear
from rig.exchange.joint import seen_from, torque_at

SPEED = 2.6
"""rad/s of the joint at which nothing drives it any more: 2980 r/min of the motor."""
LASTING, STEP = 0.5, 1e-3
HERE = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Curve:
    """Speed [rad/s] of the joint over time [s]."""

    time: np.ndarray
    speed: np.ndarray

    @property
    def standstill(self) -> float:
        """When it stands [s]: below a hundredth of the speed from which it coasts."""
        return float(self.time[np.argmax(self.speed < 1e-2 * SPEED)])


def by_equations(fine: int = 20) -> Curve:
    """J w' = -T(w), by small steps of the midpoint rule."""
    gear = identified_gear("csf-25-120")
    inertia = seen_from(gear, "joint").inertia
    times = np.arange(0.0, LASTING, STEP)
    speed, h = [SPEED], STEP / fine
    for _ in times[1:]:
        w = speed[-1]
        for _ in range(fine):
            half = w - 0.5 * h * float(torque_at(gear, "joint", w)) / inertia
            w = max(w - h * float(torque_at(gear, "joint", max(half, 0.0))) / inertia, 0.0)
        speed.append(w)
    return Curve(times, np.array(speed))


def in_mujoco(form: str) -> Curve:
    """The exported joint in MuJoCo."""
    with tempfile.TemporaryDirectory() as folder:
        path = rig.export_model("csf-25-120", Path(folder) / "joint.xml", form=form)
        model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qvel[0] = SPEED
    if model.na:
        # At this speed the bristles are bent already: F_c over their stiffness.
        data.act[0] = model.actuator_biasprm[0, 3] / model.actuator_dynprm[0, 5]
    times = np.arange(0.0, LASTING, model.opt.timestep)
    speed = [SPEED]
    for _ in times[1:]:
        mujoco.mj_step(model, data)
        speed.append(float(data.qvel[0]))
    return Curve(times, np.array(speed))


def coasting() -> dict[str, Curve]:
    """The curves of the picture."""
    return {
        "equation 20": by_equations(),
        "MuJoCo, LuGre": in_mujoco("lugre"),
        "MuJoCo, linear": in_mujoco("linear"),
    }


def draw(path: Path) -> None:
    """The picture."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    axes = figure.subplots()
    for (name, curve), style in zip(coasting().items(), ("-", "--", ":"), strict=True):
        axes.plot(curve.time, curve.speed, style, label=name, linewidth=2.0)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("speed of the joint [rad/s]")
    axes.set_title("CSF-25-120: the joint coasts, no link on it")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    draw(HERE / "screenshots" / "robot-joint.png")
