"""What a rig can do beyond exchanging cycles is what it declares, and the doctor shows it."""

from __future__ import annotations

from drivers.port import Abilities
from rig.trial.doctor.abilities import LINES, inspect_abilities
from tests.rig.fake_rig import FakeRig


def test_every_ability_has_a_line_and_a_lack_says_what_it_means() -> None:
    rig = FakeRig()
    rig.abilities = Abilities(has_quick_stop=False, events=lambda: ())
    found = {one.what: one for one in inspect_abilities(rig)}
    assert list(found) == [line.name for line in LINES]
    assert found["quick stop"].severity == "not looked at"
    assert "set-point of zero" in found["quick stop"].found
    assert found["events of devices"].severity == "passed"
    assert found["limits read back"].severity == "passed"
    assert found["stop past the loop"].severity == "not looked at"
