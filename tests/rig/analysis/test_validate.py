"""Models judged by runs that they were not fitted to: the arithmetic, and what is refused."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from experiments import catalogue
from experiments.ladder import Ladder, Rung, Sample
from experiments.recording import Recording
from model.gear_file import shipped_gear
from rig import main
from rig.analysis import validate
from rig.api.validating import Validated
from rig.errors import RigError

VALUES = {"a": [1.0, 2.0, 3.0], "b": [3.0, 5.0, 4.0], "c": [2.0, 2.0, 8.0]}


def _slope(samples: Sequence[Sample]) -> float:
    x, y = (np.concatenate([getattr(s, name) for s in samples]) for name in ("at", "measured"))
    return float(x @ y / (x @ x))


def _none_of(recording: Recording) -> Sample:
    """The toy's runs are made without a recording: see `toy`."""
    raise AssertionError(recording)


TOY = Ladder(
    quantity="toy",
    unit="N m",
    shown="mN m",
    sample=lambda recording, evidence: _none_of(recording),
    rungs=(
        Rung(
            name="mean (null)",
            parameters=1,
            fit=lambda samples: float(np.mean(np.concatenate([s.measured for s in samples]))),
            predict=lambda mean, sample: np.full(3, mean),
        ),
        Rung(name="slope", parameters=1, fit=_slope, predict=lambda k, sample: k * sample.at),
    ),
)


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    """The ladder of a toy, whose runs are three numbers each."""

    def sample(ladder: Ladder, path: Path, kind: str, choices: object) -> Sample:
        values = np.array(VALUES[path.stem])
        return Sample(
            run=path.stem,
            origin="simulated",
            measured=values,
            part=np.zeros(3, dtype=np.int64),
            at=np.array([1.0, 2.0, 3.0]),
            gear=shipped_gear(),
        )

    monkeypatch.setattr(catalogue, "ladder", lambda kind: TOY)
    monkeypatch.setattr(validate, "_sample", sample)


def paths(names: str) -> list[Path]:
    return [Path(f"{name}.h5") for name in names]


@pytest.mark.usefixtures("toy")
def test_fitted_on_these_and_judged_on_those() -> None:
    found = validate.validate_runs(paths("ab"), paths("c"), "toy")
    both = np.array(VALUES["a"] + VALUES["b"])
    mean = both.mean()
    null, slope = found.rungs
    c = np.array(VALUES["c"])
    assert null.held_out_error == pytest.approx(math.sqrt(np.mean((c - mean) ** 2)))
    x = np.array([1.0, 2.0, 3.0])
    k = (x @ VALUES["a"] + x @ VALUES["b"]) / (2.0 * x @ x)
    assert slope.held_out_error == pytest.approx(math.sqrt(np.mean((c - k * x) ** 2)))
    assert slope.skill == pytest.approx(1.0 - np.sum((c - k * x) ** 2) / np.sum((c - mean) ** 2))
    assert null.skill == 0.0
    n = found.independent
    assert null.bic == pytest.approx(n * math.log(np.mean((both - mean) ** 2)) + math.log(n))
    assert (found.fitted, found.judged) == (("a", "b"), ("c",))
    assert found.best is slope
    assert not found.is_held_out_in_turn


@pytest.mark.usefixtures("toy")
def test_every_run_is_held_out_in_its_turn() -> None:
    found = validate.validate_runs(paths("abc"), kind="toy")
    left = [
        np.array(VALUES[one]) - np.mean([VALUES[other] for other in "abc" if other != one])
        for one in "abc"
    ]
    assert found.rungs[0].held_out_error == pytest.approx(
        math.sqrt(np.mean(np.concatenate(left) ** 2))
    )
    assert found.rungs[0].fitted_error < found.rungs[0].held_out_error
    assert found.is_held_out_in_turn
    assert "each of 3 runs" in found.sentence


@pytest.mark.usefixtures("toy")
def test_table_plot_and_python_say_the_same() -> None:
    pytest.importorskip("pandas")
    found = validate.validate_runs(paths("abc"), kind="toy")
    table, plot = found.table(), found.plot()
    assert table.rows[1][3] == pytest.approx(found.rungs[1].held_out_error / 1e-3, rel=1e-3)
    assert plot.series[0].y == pytest.approx([r.held_out_error / 1e-3 for r in found.rungs])
    shown = Validated(found)
    assert shown.to_pandas().loc["slope", "skill"] == found.rungs[1].skill
    assert "least hold-out error: slope" in repr(shown)
    assert shown.plot().axes[0].get_ylabel().startswith("root mean square")


@pytest.mark.usefixtures("toy")
def test_the_command_prints_one_object_and_draws(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = tmp_path / "ladder.png"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(catalogue, "kinds", lambda: ("toy",))
    for name in "abc":
        Path(f"{name}.h5").touch()
    words = ["validate", "a.h5", "b.h5", "--on", "c.h5", "--kind", "toy"]
    with pytest.raises(SystemExit):
        main.run([*words, "--plot", str(picture), "--json"])
    told = json.loads(capsys.readouterr().out)
    assert told["judged"] == ["c"]
    assert [rung["name"] for rung in told["rungs"]] == ["mean (null)", "slope"]
    assert told["best"] == "slope"
    assert picture.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(SystemExit):
        main.run(words)
    assert "least hold-out error  slope" in capsys.readouterr().out


def test_one_run_cannot_be_fitted_and_judge() -> None:
    with pytest.raises(RigError, match="at least 2, or one to judge on"):
        validate.validate_runs(paths("a"), kind="friction")
    with pytest.raises(RigError, match=r"a\.h5: a run that is fitted cannot judge"):
        validate.validate_runs(paths("ab"), paths("a"), "friction")


def test_independent_values_of_white_and_of_coloured_rows() -> None:
    white = np.random.default_rng(9931).normal(size=4000)
    assert validate.independent_values(white) > 2500.0
    slow = np.convolve(white, np.ones(20), "same")
    assert validate.independent_values(slow) == pytest.approx(4000 / 20, rel=0.5)
    assert validate.independent_values(np.zeros(10)) == 10.0
