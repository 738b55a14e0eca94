"""The two tables of thresholds of `rig.analysis.alarm.threshold`, as they stand there.

python -m tests.benchmarks.alarm_thresholds
"""

from __future__ import annotations

from rig.analysis.alarm.promise import Promise
from rig.analysis.alarm.threshold import Days, thresholds

BASELINES = (10, 20)
BLOCKS = 40
"""Of ten thousand series: the last digit of a threshold scatters by about one."""


def main() -> None:
    """Print the rows of the table."""
    days: tuple[Days, ...] = ("independent", "alike")
    for which in days:
        for baseline in BASELINES:
            row = thresholds(Promise(baseline=baseline), which, blocks=BLOCKS)
            print(f'    ("{which}", {baseline}): {row},', flush=True)


if __name__ == "__main__":
    main()
