"""Three strangers from an empty folder, every printed line and every page kept, to be looked at.

    python -m tests.benchmarks.walks FOLDER                    # all three
    python -m tests.benchmarks.walks FOLDER --walk engineer

*technician*: from a part number to the certificate of two pages. *engineer*: from somebody's CSV to a model that is
compared. *ci*: a campaign of another project's pipeline, by its exit codes and its JUnit. Each command is what a person
types; what it prints stands in FOLDER/WALK/NN-command.txt, what it writes beside it. An exit code that is not the one
that the walk expects is marked, and is this script's own. Whether what was printed is true, and the next step obvious,
a person says.
"""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

GEAR = "SN-0815"


@dataclass(frozen=True)
class Step:
    """What is typed after `rig`, with the exit code that must come of it."""

    words: str
    code: int = 0


TECHNICIAN = (
    Step("", 2),
    Step("--help"),
    Step("doctor"),
    Step(f"plan friction --gear {GEAR}"),
    Step(f'gear new CSF-25-120-2UH --serial {GEAR} --by "A. Example"'),
    Step(f"plan friction --gear {GEAR.replace('8', '9')}", 2),
    Step(f"gear show {GEAR}"),
    Step(
        f'gear set {GEAR} --by "A. Example" --mounting circular-spline-fixed --acceptance demonstration'
    ),
    Step(f'gear confirm {GEAR} --by "A. Example"'),
    Step(f"campaign acceptance --gear {GEAR} --dry-run"),
    Step(f'campaign acceptance --gear {GEAR} --operator "A. Example"', 1),
    Step("runs"),
    Step(f"certificate --gear {GEAR} --output certificate.pdf", 1),
    Step("verify certificate.pdf"),
    Step("report runs/*friction*.h5 --output friction.html", 3),
)
ENGINEER = (
    Step("import joint.csv", 2),
    Step("import joint.csv --accept"),
    Step("show runs/00001-import-joint.h5"),
    Step("fit runs/00001-import-joint.h5", 6),
    Step("fit motion --help"),
    Step("fit motion runs/00001-import-joint.h5"),
    Step("import second.csv --accept"),
    Step("fit motion runs/00002-import-second.h5"),
    Step("diff runs/00001-import-joint.h5 runs/00002-import-second.h5"),
    Step("validate runs/00001-import-joint.h5 runs/00002-import-second.h5 --plot ladder.png"),
    Step("report runs/00001-import-joint.h5 --output joint.html"),
)
CI = (
    Step(
        f"gear new CSF-25-120-2UH --serial {GEAR} --by CI --mounting circular-spline-fixed --acceptance demonstration"
    ),
    Step(f"gear confirm {GEAR} --by CI"),
    Step(f"campaign acceptance --gear {GEAR} --dry-run --json"),
    Step(f"campaign acceptance --gear {GEAR} --junit junit.xml --json", 1),
    Step(f"campaign acceptance --gear {GEAR} --junit again.xml --json --require-verdict", 1),
    Step("verify runs --json"),
    Step("run friction --gear SN-0815 --set points=0", 2),
    Step("fit friction nowhere.h5 --json", 6),
)
WALKS = {"technician": TECHNICIAN, "engineer": ENGINEER, "ci": CI}


def joint(path: Path, seed: int) -> None:
    """Ten seconds of a joint that swings, as somebody's logger writes it: J a + F v + C sgn v = M."""
    time_s = np.arange(2500) / 250.0
    speed = 10.0 * np.sin(3.0 * time_s) + 4.0 * np.sin((6.0 + 0.1 * seed) * time_s)
    angle = np.cumsum(speed) / 250.0
    noise = 2e-3 * np.random.default_rng(seed).standard_normal(len(time_s))
    torque = 0.05 * np.gradient(speed, time_s) + 0.02 * speed + 0.3 * np.sign(speed) + noise
    table = np.column_stack([time_s, np.rad2deg(angle), torque])
    np.savetxt(path, table, delimiter=";", header="Time [s];Angle [deg];Torque [Nm]", comments="")


def walked(name: str, folder: Path) -> int:
    """How many commands of a walk ended otherwise than they must."""
    folder.mkdir(parents=True)
    joint(folder / "joint.csv", 1)
    joint(folder / "second.csv", 2)
    rig = Path(sys.executable).with_name("rig")
    wrong = 0
    for number, step in enumerate(WALKS[name], 1):
        begun = time.monotonic()
        ended = subprocess.run(
            f"{shlex.quote(str(rig))} {step.words}",
            shell=True,
            cwd=folder,
            env={**os.environ, "COLUMNS": "80"},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        seconds = time.monotonic() - begun
        slug = "-".join(word for word in step.words.split()[:2] if word.isalpha()) or "alone"
        said = f"$ rig {step.words}\n{ended.stdout}"
        errors = f"\n--- standard error\n{ended.stderr}" if ended.stderr else ""
        tail = f"\n--- exit {ended.returncode}, {seconds:.1f} s\n"
        (folder / f"{number:02d}-{slug}.txt").write_text(said + errors + tail, encoding="utf-8")
        is_right = ended.returncode == step.code
        wrong += not is_right
        mark = "" if is_right else f"  expected {step.code}"
        print(
            f"{name} {number:2d}  exit {ended.returncode}  {seconds:5.1f} s  rig {step.words}{mark}"
        )
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--walk", choices=tuple(WALKS))
    arguments = parser.parse_args()
    names = (arguments.walk,) if arguments.walk else tuple(WALKS)
    return min(1, sum(walked(name, arguments.folder / name) for name in names))


if __name__ == "__main__":
    sys.exit(main())
