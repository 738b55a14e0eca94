"""What only motion tells: directions and ratio, found wrong when they are wrong, and standstill whatever happens."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from model.gear_file import shipped_gear
from rig.bench.backends.assembly import AssembledRig
from rig.run.latch import LATCH_NAME
from rig.run.stop import StopRequest
from rig.trial.doctor.examine import examine
from sim_backend.faults import DriveFault
from tests.rig.trial.doctor_rigs import (
    Change,
    counter,
    failed,
    line,
    look,
    motor_encoder,
    on_the_wire,
    request,
    torque_input,
    wire_bench,
)


def test_a_rig_that_is_fine_is_fine(tmp_path: Path) -> None:
    found = look(tmp_path, on_the_wire, moves=True)
    assert found.is_fine, failed(found)
    ratio = line(found, "motion", "ratio")
    assert ratio.value == pytest.approx(120.0, abs=0.02)
    for name in (
        "input direction",
        "output direction",
        "torque direction",
        "torque scale",
        "cycles",
    ):
        assert line(found, "motion", name).severity == "passed", name
    # Nothing of the motion is kept where the runs go.
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "name", "trips"),
    [
        (lambda c: counter(c, direction=-1), "output direction", True),
        (lambda c: motor_encoder(c, direction=-1), "torque direction", True),
        (lambda c: torque_input(c, direction=-1), "torque direction", True),
        (lambda c: counter(c, multiplication=2), "ratio", True),
        # Too little for the guard within a cycle: it is the slip that is seen to grow.
        (lambda c: counter(c, lines=17996), "ratio", True),
    ],
)
def test_a_wrong_channel_is_found_by_moving(
    tmp_path: Path, change: Change, name: str, trips: bool
) -> None:
    found = look(tmp_path, lambda: on_the_wire(change), moves=True)
    assert line(found, "motion", name).severity == "blocks"
    assert not found.is_fine
    # However wrong the channels are, the rig stands in the end, and that was verified.
    run = line(found, "motion", "run")
    assert "standstill verified" in run.found
    assert ("TRIPPED" in run.found) == trips
    # A trip is latched where the next run looks, although the recording is thrown away.
    assert (tmp_path / LATCH_NAME).exists() == trips


def test_a_ratio_that_is_described_wrongly_is_found(tmp_path: Path) -> None:
    # 238 teeth on 240: 119 instead of 120.
    other = shipped_gear().with_values({"teeth.flexspline": 238, "teeth.circular_spline": 240})
    found = look(tmp_path, on_the_wire, moves=True, gear=other)
    ratio = line(found, "motion", "ratio")
    assert ratio.severity == "blocks"
    assert "described as 119" in ratio.found
    assert ratio.value == pytest.approx(120.0, abs=0.5)


def test_the_ratio_of_the_other_mounting_is_recognised(tmp_path: Path) -> None:
    def mounted() -> AssembledRig:
        bench = wire_bench(mounting="flexspline-fixed")
        return on_the_wire(lambda c: counter(c, direction=-1), bench=bench)

    ratio = line(look(tmp_path, mounted, moves=True), "motion", "ratio")
    assert ratio.severity == "blocks"
    assert ratio.value == pytest.approx(121.0, abs=0.3)
    assert "121 is the ratio of the other mounting" in ratio.remedy


def test_without_an_output_encoder_the_input_is_looked_at(tmp_path: Path) -> None:
    found = look(tmp_path, lambda: on_the_wire(lambda c: replace(c, counters=())), moves=True)
    assert line(found, "encoders", "output angle").severity == "warns"
    assert line(found, "motion", "input direction").severity == "passed"
    assert line(found, "motion", "output direction and ratio").severity == "not looked at"


def test_a_drive_that_trips_in_motion_is_latched(tmp_path: Path) -> None:
    # The stage in motion opens the rig anew: its cycle 300 lies in the turn, that of the stage at
    # rest is never reached.
    found = look(tmp_path, lambda: on_the_wire(lambda c: c, DriveFault(300)), moves=True)
    run = line(found, "motion", "run")
    assert run.severity == "blocks"
    assert "standstill verified" in run.found
    assert (tmp_path / LATCH_NAME).exists()


@pytest.mark.parametrize("stage", ["standing", "motion"])
def test_the_operator_stops_it(tmp_path: Path, stage: str) -> None:
    stop = StopRequest()
    found = examine(
        on_the_wire,
        request(tmp_path),
        moves=True,
        stop=stop,
        on_stage=lambda now: stop.stop() if now == stage else None,
    )
    assert found.was_stopped
    assert not found.is_fine
    # That somebody stopped it is nothing that failed.
    assert not failed(found)
    if stage == "standing":
        assert line(found, "motion", "direction and ratio").found == "stopped by the operator"
    else:
        assert "ABORTED, standstill verified" in line(found, "motion", "run").found
