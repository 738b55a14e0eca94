"""What a refresh of the large live numbers costs: other texts and their painting, in processor time.

QT_QPA_PLATFORM=offscreen python -m tests.benchmarks.live_numbers_study --refreshes 300
"""

from __future__ import annotations

import argparse
import time


def main() -> None:
    """Paint the four numbers over and over and say how long one refresh takes."""
    from PySide6.QtWidgets import QApplication

    from rig.window.run.live_numbers import LiveNumbers
    from rig.window.shell.theme import apply_theme

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--refreshes", type=int, default=300)
    parser.add_argument("--width", type=int, default=1346, help="pixels")
    chosen = parser.parse_args()
    application = QApplication([])
    apply_theme(application, "light")
    numbers = LiveNumbers()
    numbers.resize(chosen.width, 52)
    numbers.show()
    application.processEvents()
    begin = time.process_time()
    for number in range(chosen.refreshes):
        # Each label is given another text, as in the busiest refresh of a run.
        for place, label in enumerate(numbers._labels.values()):
            label.setText(f"{number + place}.{number % 10} r/min")
        application.processEvents()
        numbers.grab()
    spent = (time.process_time() - begin) / chosen.refreshes
    print(f"{1e3 * spent:.2f} ms of processor time per refresh of four numbers")


if __name__ == "__main__":
    main()
