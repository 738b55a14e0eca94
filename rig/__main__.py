"""The command `rig`, as the console script and `python -m rig` start it: packages that are not ours are named first."""

from __future__ import annotations

import sys

from rig.floors import foreign_floor

ERROR = 6
"""The exit code of `rig.exits`, which cannot be imported where a package under it is not ours."""


def run() -> None:
    """The command line, or one sentence on a package that stands in the way of it."""
    sentence = foreign_floor()
    if sentence:
        sys.stderr.write(f"{sentence}\n")
        raise SystemExit(ERROR)
    from rig.main import run as command

    command()


if __name__ == "__main__":
    run()
