"""The command `rig`, as the console script and `python -m rig` start it: packages that are not ours are named first."""

from __future__ import annotations

import gc
import sys

from rig.floors import foreign_floor

ABORTED, ERROR = 4, 6
"""Exit codes of `rig.exits`, which cannot be imported where a package under it is not ours, or while it is imported."""
gc.set_threshold(20_000, 20, 50)
# What a command imports lives as long as it does: at the interpreter's thresholds a tenth of a short command goes by
# looking through it again and again for what nobody holds.
_STOPPED = "Stopped by the operator; no rig was moving."


def run() -> None:
    """The command line, or one sentence on a package that stands in the way of it, or on a Ctrl-C while it starts."""
    try:
        sentence = foreign_floor()
        if sentence:
            sys.stderr.write(f"{sentence}\n")
            raise SystemExit(ERROR)
        from rig.main import run as command
    except KeyboardInterrupt:
        if "--json" in sys.argv or "--events" in sys.argv:
            parts = '"where": null, "value": null, "limit": null, "remedy": null'
            error = f'"kind": "KeyboardInterrupt", {parts}, "message": "{_STOPPED}"'
            sys.stdout.write(f'{{"error": {{{error}}}}}\n')
        else:
            sys.stderr.write(f"{_STOPPED}\n")
        raise SystemExit(ABORTED) from None
    command()


if __name__ == "__main__":
    run()
