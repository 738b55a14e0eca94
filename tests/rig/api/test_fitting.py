"""From runs to results: the same numbers as the rest of the program, by name and with uncertainty."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rig
from experiments.errors import AnalysisError
from rig.analysis.fit.recorded import fit_recording
from rig.analysis.fit.run import fit_run
from rig.errors import RigError
from tests.rig import handmade
from tests.rig.api.recordings import made, swinging
from tests.rig.importing import bring_in


@pytest.fixture(scope="module")
def swing() -> rig.Result:
    return rig.fit(swinging(), "motion")


def test_a_value_is_that_of_the_analysis(swing: rig.Result) -> None:
    told = fit_recording(swinging().recording, "motion").result.estimates
    assert set(swing) == set(told)
    for name, value in swing.items():
        assert value.value == told[name].value
        assert value.uncertainty == told[name].expanded_uncertainty
        assert value.unit == told[name].unit
        assert value.interval == (told[name].low, told[name].high)
        assert float(value) == value.value


def test_a_name_that_is_not_there_is_refused_with_those_that_are(swing: rig.Result) -> None:
    with pytest.raises(rig.WordedError, match=r"no such value; value 'colomb', allowed .*coulomb"):
        swing["colomb"]
    assert swing.get("colomb") is None
    assert "colomb" not in swing


def test_a_frame_of_a_result(swing: rig.Result) -> None:
    pytest.importorskip("pandas")
    frame = swing.to_pandas()
    assert frame.loc["coulomb", "value"] == swing["coulomb"].value
    assert frame.loc["coulomb", "unit"] == "N m"


def test_several_runs_are_several_results_with_what_lies_between_them() -> None:
    pytest.importorskip("pandas")
    runs = [swinging("A", seed=9911), swinging("B", seed=9912)]
    results = rig.fit(runs, "motion")
    assert [one.run_id for one in results] == ["A", "B"]
    values = [one["coulomb"].value for one in results]
    mean, deviation = results.pooled["motion.coulomb"]
    assert mean == pytest.approx(np.mean(values))
    assert deviation == pytest.approx(np.std(values, ddof=1))
    assert results.to_pandas().loc[("B", "coulomb"), "value"] == values[1]


def test_settings_are_those_of_the_analysis() -> None:
    with pytest.raises(AnalysisError, match="colour"):
        rig.fit(swinging(), "motion", colour="red")


def test_a_recording_without_a_kind_is_refused_as_on_the_command_line() -> None:
    with pytest.raises(RigError, match="the kind of fit must be named"):
        rig.fit(swinging())


def test_a_run_file_is_fitted_as_the_command_does_and_stored_when_asked(tmp_path: Path) -> None:
    table = tmp_path / "swing.csv"
    run = swinging()
    rows = np.column_stack([run.time, run["input_angle"], run["torque"]])
    np.savetxt(table, rows, delimiter=",", header="t [s],angle [rad],M [N m]", comments="")
    path = bring_in(table, "time=t:s", "input_angle=angle:rad", "torque=M:N m").path
    result = rig.fit(path, "motion")
    assert result["coulomb"].value == fit_run(path, "motion").result.estimates["coulomb"].value
    assert not path.with_name(f"{path.stem}.analysis").exists()
    assert result.store()
    assert path.with_name(f"{path.stem}.analysis").is_dir()


def test_a_result_in_memory_has_no_store(swing: rig.Result) -> None:
    with pytest.raises(RigError, match="rig import"):
        swing.store()


def test_a_report_is_refused_in_a_form_that_it_has_not(swing: rig.Result, tmp_path: Path) -> None:
    with pytest.raises(RigError, match=r"a report is \.html or \.pdf"):
        rig.report(swing, tmp_path / "x.docx")
    assert not list(tmp_path.iterdir())


def test_a_tare_that_is_none_is_refused() -> None:
    bare = made({"torque": ("N m", np.zeros(50))}, experiment="friction")
    with pytest.raises(rig.WordedError):
        rig.fit(bare, "friction", tare=swinging())


def test_covariance_figures_and_tables() -> None:
    result = rig.Result(handmade.fit())
    assert result.covariance is None
    assert result.figures == {"friction": "Friction torque at the input over speed"}
    drawn = result.plot("17")
    assert drawn.axes[0].get_xlabel() == "Input speed [r/min]"
    assert result.plot().axes[0].get_xlabel() == "Input speed [r/min]"
    with pytest.raises(AnalysisError, match=r"value '12', allowed friction \(9, 17\)"):
        result.plot("12")
    assert set(result.tables) == {"points"}


def test_a_result_fits_a_screen_with_its_warnings() -> None:
    text = repr(rig.Result(handmade.fit()))
    assert all(len(line) <= 100 for line in text.splitlines())
    assert "SIMULATED" in text
    assert "87.3 ± 2." in text
    assert "drifted by 1.2 %" in text
    assert "no" in text
    assert rig.Result(handmade.fit())._repr_html_().count("<tr>") == 7


def test_a_parameter_set_is_held_against_a_run() -> None:
    result = rig.Result(handmade.fit())
    other = rig.gear("SHG-32-100-2UH")
    with pytest.raises(RigError, match="another ratio"):
        result.compare(other)
