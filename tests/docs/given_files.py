"""The files that a reader of a page is taken to have: recordings of other rigs."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.rig.library.stored import RUNNING, analyse, estimate, write

FOREIGN = Path(__file__).parents[1] / "data" / "foreign"
_MAP = re.compile(r"^```toml\n(.*?)^```", re.DOTALL | re.MULTILINE)
RATE = 200.0


def lay_out(page: Path, folder: Path) -> None:
    """Put the files of a page into a folder; nothing for a page that takes none."""
    GIVEN.get(page.stem, lambda page, folder: None)(page, folder)


def _recordings(page: Path, folder: Path) -> None:
    """Joints that swing, their maps as the page prints them, a scope export, a table of friction."""
    time = np.arange(2400) / RATE
    speed = 2.0 * np.sin(1.1 * time) + 0.7 * np.sin(2.9 * time)
    acceleration = 2.2 * np.cos(1.1 * time) + 2.03 * np.cos(2.9 * time)
    angle = np.cumsum(speed) / RATE
    current = 0.02 * acceleration + 0.03 * speed + 0.1 * np.sign(speed)
    _write(folder / "joint.csv", "t,q,M", time, angle, 1e3 * current)
    _write(folder / "position.csv", "t,arm_1,arm_2", time, angle, angle)
    _write(folder / "effort.csv", "t,arm_1,arm_2", time, current, current)
    _write(folder / "angles.csv", "Joint_1,Joint_4", 32.0 * angle, -48.0 * angle)
    _write(folder / "torques.csv", "Joint_1,Joint_4", current, -current)
    first, *_ = _MAP.findall(page.read_text(encoding="utf-8"))
    (folder / "joints.toml").write_text(first, encoding="utf-8")
    (folder / "scope.csv").write_bytes((FOREIGN / "twincat_scope_default.csv").read_bytes())
    rpm = np.array([10.0, 30.0, 100.0, 300.0, 1000.0])
    _write(folder / "friction.csv", "n,M,u", rpm, 60.0 + 0.02 * rpm, np.ones(5))


def _write(path: Path, headings: str, *columns: np.ndarray) -> None:
    np.savetxt(path, np.column_stack(columns), "%.9g", ",", header=headings, comments="")


def _gear(page: Path, folder: Path) -> None:
    """A gear A1 with one analysed run."""
    (folder / "runs").mkdir()
    analyse(write(folder / "runs", 1), estimate(RUNNING, 0.08))


def _joint(page: Path, folder: Path) -> None:
    """Joint 1 of the TIAGo arm."""
    (folder / "arm_1.csv").write_bytes((FOREIGN.parent / "tiago_arm" / "arm_1.csv").read_bytes())


GIVEN: dict[str, Callable[[Path, Path], None]] = {
    "import-a-recording": _recordings,
    "sign-a-manifest": _gear,
    "your-own-recording": _joint,
}
