"""What is read from across the room while a rig turns: speed, torque, temperature and time left, as large numbers."""

from __future__ import annotations

import math

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFrame, QLabel, QSizePolicy, QWidget

from experiments.recording import Recording
from model.units import RPM
from rig.run.progress import in_words
from rig.window.run.live_view import cycle_period, torque_channel
from rig.window.shell.stack import in_column, in_row, text_label
from rig.window.work.live_file import Block, SlidingSpeed

NOTHING = "–"
LATEST = 0.2
"""s over which speed and torque are averaged: a number that trembles cannot be read."""
NUMBERS = ("speed", "torque", "temperature", "time left")
_CAPTIONS = {
    "torque": "motor torque",
    "drive_torque": "torque by the drive",
    "housing_temperature": "housing",
    "ambient_temperature": "room",
}
"""What stands under a number, by the channel that it comes from."""


class LiveNumbers(QWidget):
    """Four numbers. `begin` names the run, `take` new rows, `show_latest` writes what they say."""

    def __init__(self) -> None:
        super().__init__()
        self._labels: dict[str, QLabel] = {}
        self._captions: dict[str, QLabel] = {}
        tiles = [self._tile(name) for name in NUMBERS]
        self.setLayout(in_row(*((tile, 1) for tile in tiles), margins=(0, 0, 0, 0), spacing=8))
        self._speed: SlidingSpeed | None = None
        self._torque = self._temperature = ""
        self.clear()

    def _tile(self, name: str) -> QFrame:
        number = text_label(NOTHING, "number")
        number.setAccessibleName(name.capitalize())
        # The number may change five times a second: nothing around it moves for that.
        number.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        caption = text_label(name, "muted")
        caption.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        for label in (number, caption):
            label.setAlignment(Qt.AlignmentFlag.AlignHCenter)
        self._labels[name], self._captions[name] = number, caption
        tile = QFrame()
        tile.setProperty("part", "card")
        tile.setLayout(in_column(number, caption, margins=(8, 0, 8, 2), spacing=0))
        return tile

    @property
    def texts(self) -> dict[str, str]:
        """What stands there, by name."""
        return {name: label.text() for name, label in self._labels.items()}

    def clear(self) -> None:
        """No run."""
        self._speed = None
        self._values: dict[str, float] = {}
        for label in self._labels.values():
            label.setText(NOTHING)

    def begin(self, recording: Recording) -> None:
        """A run whose rows come from now on."""
        self._speed = SlidingSpeed(cycle_period(recording))
        self._torque = torque_channel(recording)
        housing = recording.has("housing_temperature")
        self._temperature = "housing_temperature" if housing else "ambient_temperature"
        for name, channel in (("torque", self._torque), ("temperature", self._temperature)):
            self._captions[name].setText(_CAPTIONS[channel])
        self._captions["speed"].setText("input speed")

    @property
    def wanted(self) -> tuple[str, ...]:
        """Channels that are read."""
        return ("input_angle", self._torque, self._temperature)

    def take(self, block: Block) -> None:
        """New rows; incomplete cycles are left out."""
        if self._speed is None or not block.good.any():
            return
        time = block.time[block.good]
        late = time >= time[-1] - LATEST
        for name in (self._torque, self._temperature):
            if name in block.si:
                self._values[name] = float(block.si[name][block.good][late].mean())
        if "input_angle" in block.si:
            stamps, speed = self._speed.of(block, "input_angle")
            if len(stamps):
                self._values["speed"] = float(speed[stamps >= stamps[-1] - LATEST].mean())

    def show_latest(self) -> None:
        """Write what the latest rows say."""
        speed = self._values.get("speed", math.nan) / RPM
        torque = self._values.get(self._torque, math.nan) * 1e3
        temperature = self._values.get(self._temperature, math.nan)
        self._write("speed", f"{speed:.0f} r/min" if abs(speed) >= 100.0 else f"{speed:.1f} r/min")
        self._write("torque", f"{torque:.1f} mN m")
        self._write("temperature", f"{temperature:.1f} °C")

    def show_left(self, seconds: float, later: float = 0.0) -> None:
        """Nominal time left [s] of the run; `later` of the runs of its campaign that follow."""
        self._labels["time left"].setText(in_words(seconds + later))
        self._captions["time left"].setText(
            f"left, {in_words(seconds)} of this run" if later else "left"
        )

    def _write(self, name: str, text: str) -> None:
        text = NOTHING if "nan" in text else text.replace("-", "\u2212")
        if self._labels[name].text() != text:
            self._labels[name].setText(text)
