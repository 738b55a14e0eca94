"""The tare that is found by itself: what it must share with the run, and what is said of every one that does not."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.channel import Channel
from experiments.recording import ArraySource, Recording, RunMetadata
from rig.analysis.fit import run as fitting
from rig.analysis.fit.recorded import TARE_DECLINED
from rig.analysis.fit.run import Choices
from rig.analysis.tare import FoundTare, find_tare, tare_days_of, tares_beside, tares_wanted
from rig.library.index import LibraryIndex
from rig.runfile.layout import Column
from rig.runfile.write import RunWriter
from tests.rig import handmade
from tests.rig.bench.test_configuration import TEMPLATE
from tests.rig.runfile.making import CHANNELS, CYCLE_NS, block, header

RIG = {"motor": "M-1", "bench": "B-1", "backend": "sim"}
TORQUE = CHANNELS[2]
TEMPERATURES = ("housing_temperature", "ambient_temperature")
WARM = {"housing_temperature": 30.0, "ambient_temperature": 22.0}


def channels(torque: Channel, warmth: Mapping[str, float]) -> list[Channel]:
    made = [Channel(name=name, unit="degC", scale=0.01) for name in TEMPERATURES if name in warmth]
    return [torque, *made]


def counted(warmth: Mapping[str, float]) -> np.ndarray:
    row = [100, *(round(100 * warmth[name]) for name in TEMPERATURES if name in warmth)]
    return np.tile(np.array(row, dtype=np.int64), (8, 1))


def write(
    folder: Path,
    number: int,
    day: int,
    *,
    protocol: str = "motor-tare",
    outcome: str = "COMPLETED",
    torque: Channel = TORQUE,
    warmth: Mapping[str, float] = WARM,
    process: Mapping[str, Any] = RIG,
    **metadata: Any,
) -> Path:
    """A sealed run of a day of March 2026 at noon; a motor tare of the run's own rig, unless something else is said."""
    made = header(f"{number:05d}-{protocol}-bare")
    told = {
        "experiment": protocol,
        "gear_serial": "",
        "gear_mounted": False,
        "start_time": f"2026-03-{day:02d}T12:00:00+00:00",
        "process": {"backend": "sim", **process},
        **metadata,
    }
    made = dataclasses.replace(
        made,
        metadata=dataclasses.replace(made.metadata, **told),
        columns=tuple(Column.of(channel) for channel in channels(torque, warmth)),
    )
    writer = RunWriter(folder / f"{made.metadata.run_id}.h5", made, chunk_rows=64)
    writer.append(dataclasses.replace(block(1000 * number, 8), counts=counted(warmth)))
    return writer.seal(outcome, told["start_time"])


def run_of(warmth: Mapping[str, float] = WARM, **metadata: Any) -> Recording:
    """A friction run of the 10th of March."""
    signals = {channel.name: channel for channel in channels(TORQUE, warmth)}
    arrays = dict(zip(signals, counted(warmth).T, strict=True))
    made = RunMetadata(
        run_id="00090-friction-A1",
        experiment="friction",
        origin="simulated",
        start_time="2026-03-10T12:00:00+00:00",
        process=RIG,
        **metadata,
    )
    source = ArraySource(arrays, np.arange(8, dtype=np.int64) * CYCLE_NS)
    return Recording(made, signals, (), (), source)


def found(folder: Path, run: Recording | None = None, **more: Any) -> FoundTare:
    return find_tare(run or run_of(), LibraryIndex(folder), **more)


def test_the_newest_before_the_run_is_found_and_says_why(tmp_path: Path) -> None:
    write(tmp_path, 1, 5)
    newest = write(tmp_path, 2, 9)
    write(tmp_path, 3, 11)
    tare = found(tmp_path)
    assert tare.path == newest
    assert tare.age_days == pytest.approx(1.0)
    assert tare.because == (
        "00002-motor-tare-bare: 1.0 days old, same motor, bench and calibration, housing 0.0 K apart",
    )


def test_where_there_is_none_before_the_first_after_it_is_found(tmp_path: Path) -> None:
    first = write(tmp_path, 1, 11)
    write(tmp_path, 2, 12)
    tare = found(tmp_path)
    assert tare.path == first
    assert "made 1.0 days after this run" in tare.because[0]


OTHER_TORQUE = dataclasses.replace(TORQUE, serial_number="8")


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"process": {**RIG, "motor": "M-2"}}, "motor M-2, this run's is M-1"),
        ({"process": {**RIG, "bench": "B-2"}}, "bench B-2, this run's is B-1"),
        ({"torque": OTHER_TORQUE}, "torque channel EL3104 8"),
        ({"warmth": {**WARM, "housing_temperature": 35.1}}, "housing 5.1 K apart, limit 5 K"),
        ({"day": 2}, "8.0 days old, limit 7"),
        ({"outcome": "ABORTED"}, "ended ABORTED"),
        ({"gear_mounted": True}, "was taken with a gear mounted"),
    ],
)
def test_what_is_not_the_runs_tare_says_why(
    tmp_path: Path, changes: dict[str, Any], reason: str
) -> None:
    write(tmp_path, 1, **{"day": 9, **changes})
    tare = found(tmp_path)
    assert tare.path is None
    (words,) = tare.because
    assert words.startswith(f"00001-motor-tare-bare: {reason}")


def test_the_housing_counts_before_the_room(tmp_path: Path) -> None:
    """A room that cooled overnight says nothing where the housing is as warm as it was."""
    path = write(tmp_path, 1, 9, warmth={**WARM, "ambient_temperature": 12.0})
    assert found(tmp_path).path == path


def test_the_room_counts_where_one_of_the_two_has_no_housing(tmp_path: Path) -> None:
    path = write(tmp_path, 1, 9, warmth={"ambient_temperature": 20.5})
    assert found(tmp_path).path == path
    assert "room 1.5 K apart" in found(tmp_path).because[0]
    colder = run_of({"housing_temperature": 30.0, "ambient_temperature": 14.0})
    assert "room 6.5 K apart, limit 5 K" in found(tmp_path, colder).because[0]


def test_a_temperature_that_nobody_recorded_speaks_against_nobody(tmp_path: Path) -> None:
    path = write(tmp_path, 1, 9, warmth={})
    assert found(tmp_path).path == path
    assert "temperature not recorded" in found(tmp_path).because[0]


def test_a_trip_of_the_bench_in_between_speaks_against_it(tmp_path: Path) -> None:
    write(tmp_path, 1, 8)
    tripped: dict[str, Any] = {"protocol": "friction", "outcome": "TRIPPED"}
    write(tmp_path, 2, 9, **tripped, process={**RIG, "bench": "B-2"})
    assert found(tmp_path).path is not None
    write(tmp_path, 3, 9, **tripped)
    tare = found(tmp_path)
    assert tare.path is None
    assert "00003-friction-bare tripped between it and this run" in tare.because[0]
    # A tare after the trip is one again.
    path = write(tmp_path, 4, 10)
    assert found(tmp_path).path == path


def test_a_folder_without_a_tare_says_so(tmp_path: Path) -> None:
    write(tmp_path, 1, 9, origin="imported")
    assert found(tmp_path).because == (f"there is no simulated motor-tare run in {tmp_path}",)


def test_the_setting_of_the_rig_says_how_old_a_tare_may_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    write(runs, 1, 1)
    monkeypatch.chdir(tmp_path)
    assert found(runs, tare_days=tare_days_of(runs)).path is None
    described = TEMPLATE.replace("[rig]\n", "[rig]\ntare_days = 10\n", 1)
    Path("rig.toml").write_text(described, encoding="utf-8")
    assert tare_days_of(runs) == 10.0
    assert found(runs, tare_days=tare_days_of(runs)).path is not None
    # The description of another folder says nothing of this one.
    assert tare_days_of(tmp_path) == 7.0


def test_by_hand_a_tare_is_taken_as_it_is_or_left_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen, run = write(tmp_path, 1, 2), tmp_path / "00090-friction-A1.h5"
    write(tmp_path, 2, 9)
    tare_fit = handmade.fit()
    monkeypatch.setattr(fitting, "_tare_fit", lambda path, choices: tare_fit)
    by_hand = fitting._tare_for(run_of(), run, "friction", Choices(tare=chosen))
    assert (by_hand.fit, by_hand.found.path, by_hand.found.by_hand) == (tare_fit, chosen, True)
    none = fitting._tare_for(run_of(), run, "friction", Choices(no_tare=True))
    assert (none.fit, none.found.because) == (None, (TARE_DECLINED,))
    by_itself = fitting._tare_for(run_of(), run, "friction", Choices())
    assert by_itself.found.path is not None
    assert by_itself.found.path.name == "00002-motor-tare-bare.h5"
    # What takes no tare is not offered one.
    assert fitting._tare_for(run_of(), run, "kinematic-error", Choices()).found == FoundTare()


def test_the_other_tares_of_a_bench_are_its_witnesses_whatever_their_age(tmp_path: Path) -> None:
    old, chosen = write(tmp_path, 1, 1), write(tmp_path, 2, 9)
    after = write(tmp_path, 3, 12, warmth={**WARM, "housing_temperature": 45.0})
    write(tmp_path, 4, 8, process={**RIG, "bench": "B-2"})
    write(tmp_path, 5, 8, torque=OTHER_TORQUE)
    write(tmp_path, 6, 8, outcome="ABORTED")
    write(tmp_path, 7, 8, gear_mounted=True)
    beside = list(tares_beside(run_of(), LibraryIndex(tmp_path), chosen))
    assert beside == [after, old]


def test_a_plan_asks_for_a_second_tare(tmp_path: Path) -> None:
    assert "no motor tare" in tares_wanted("friction", tmp_path / "runs")
    write(tmp_path, 1, 1)
    write(tmp_path, 2, 1, outcome="ABORTED")
    wanted = tares_wanted("friction", tmp_path)
    assert "one motor tare only" in wanted
    assert wanted.endswith("rig run motor-tare.")
    assert not tares_wanted("home", tmp_path)
    write(tmp_path, 3, 9)
    assert not tares_wanted("friction", tmp_path)


def test_an_analysis_names_the_tares_that_its_tare_was_held_against(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen, other = write(tmp_path, 1, 9), write(tmp_path, 2, 8)
    fits: dict[Path, Any] = {}

    def tare_fit(path: Path, choices: Choices) -> Any:
        return fits.setdefault(path, dataclasses.replace(handmade.fit(), path=path))

    monkeypatch.setattr(fitting, "_tare_fit", tare_fit)
    monkeypatch.setattr(fitting.read, "close_recording", lambda recording: None)
    run, choices = tmp_path / "00090-friction-A1.h5", Choices()
    surroundings = fitting.Surroundings()
    tared = fitting._tare_for(run_of(), run, "friction", choices, surroundings)
    found = fitting._other_tares(run_of(), run, "friction", tared, choices, surroundings)
    assert tared.fit is fits[chosen]
    assert [one.named["file"] for one in found] == [other.name]
    assert found[0].result is fits[other].result
    # A tare is held against the others itself; what subtracts none has no use for them.
    own = fitting._other_tares(
        run_of(), chosen, "motor-tare", fitting.Tared(), choices, surroundings
    )
    assert [one.named["file"] for one in own] == [other.name]
    nothing = fitting._other_tares(
        run_of(), run, "kinematic-error", fitting.Tared(), choices, surroundings
    )
    assert nothing == ()


def test_a_fit_without_a_tare_says_why_and_what_is_lost() -> None:
    fit = handmade.fit()
    why = FoundTare(None, ("there is no simulated motor-tare run in runs",))
    without = dataclasses.replace(fit, tare=None, named_tare={}, found_tare=why)
    assert without.tare_words == (
        "there is no simulated motor-tare run in runs",
        "without a motor-tare the torque is that of motor and gear together",
    )
    assert without.lacks_tare
    by_hand = dataclasses.replace(without, found_tare=FoundTare(None, (TARE_DECLINED,)))
    assert not by_hand.lacks_tare
