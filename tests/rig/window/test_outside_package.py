"""A protocol of another package in the window: offered with its fields; one that does not load is not offered."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QLabel
from pytestqt.qtbot import QtBot

from experiments import extensions
from rig.window.prepare.protocol import ProtocolSection
from rig.window.shell.session import WindowSession
from tests.outside_package import found_in, installed_into


def test_the_form_offers_it_and_leaves_out_what_is_broken(
    session: WindowSession, qtbot: QtBot, tmp_path: Path
) -> None:
    site = installed_into(tmp_path / "site")
    points = site / "lab_noise-1.2.dist-info" / "entry_points.txt"
    text = points.read_text(encoding="utf-8")
    broken = "[harmonic_rig.protocols]\nbroken = lab_noise.nowhere:EXPERIMENT\n"
    points.write_text(text.replace("[harmonic_rig.protocols]\n", broken), encoding="utf-8")
    with found_in(site):
        section = ProtocolSection(session)
        qtbot.addWidget(section)
        section.choice.setCurrentIndex(section.choice.findData("torque-noise"))
        assert section.protocol == "torque-noise"
        assert section.form.values() == {"duration": "5", "zero_time": "3"}
        texts = {label.text() for label in section.findChildren(QLabel)}
        assert any("lab-noise 1.2" in text for text in texts)
        assert section.choice.findData("broken") == -1
        assert [one.name for one, _ in extensions.left_out()] == ["broken"]
