"""The catalogue is light, complete, and every protocol keeps the contract."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from importlib import import_module

import pytest

from experiments import catalogue
from experiments.contract import Deferred, Experiment
from experiments.errors import PlanError
from experiments.parameters import make_parameters
from model.gear_file import shipped_gear
from rig.testing.protocol import check_protocol

PROTOCOLS = (
    "kinematic-error",
    "compensated-error",
    "friction",
    "velocity-steps",
    "motor-tare",
    "torque-scale",
    "warm-up",
    "starting-torque",
    "home",
)
FUNCTIONS = ("plan", "analyse", "compare", "identified", "learns")
"""The functions of an experiment."""


def test_the_catalogue_lists_names_without_importing_arrays() -> None:
    code = (
        "import sys; from experiments import catalogue; catalogue.names(); catalogue.kinds();"
        "sys.exit(any(m in sys.modules for m in ('numpy', 'scipy', 'numba', 'h5py', 'pydantic', 'matplotlib')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_what_everything_declares_is_known_without_what_it_computes_with() -> None:
    code = (
        "import sys; from experiments import catalogue; [catalogue.load(kind) for kind in catalogue.kinds()];"
        "print([m for m in ('numpy', 'scipy', 'numba') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "[]", done.stderr


def test_names_and_kinds() -> None:
    assert catalogue.names() == PROTOCOLS
    assert catalogue.kinds()[: len(PROTOCOLS)] == PROTOCOLS
    assert set(catalogue.kinds()) - set(PROTOCOLS) == {
        "motion",
        "friction-curve",
        "revolution",
        "order-spectrum",
        "skew",
        "hysteresis",
    }


def test_an_unknown_name_is_refused_with_those_there_are() -> None:
    with pytest.raises(PlanError, match="friction"):
        catalogue.load("frictoin")


@pytest.mark.parametrize("name", catalogue.kinds())
def test_every_experiment_keeps_the_contract(name: str) -> None:
    experiment = catalogue.load(name)
    entry = catalogue.entry(name)
    assert isinstance(experiment, Experiment)
    assert experiment.name == name
    assert experiment.has_plan == entry.has_plan
    assert dataclasses.is_dataclass(experiment.parameters)
    declared: Experiment = import_module(entry.module).EXPERIMENT
    assert declared.version == experiment.version
    functions = [getattr(declared, name) for name in FUNCTIONS]
    for function in [f for f in functions if f is not None]:
        there = function.function if isinstance(function, Deferred) else function
        assert callable(there)
        assert there.__doc__
    check_protocol(experiment)


@pytest.mark.parametrize("name", catalogue.kinds())
def test_every_analysis_says_what_it_asks_of_a_recording_made_elsewhere(name: str) -> None:
    asks = catalogue.load(name).asks
    assert asks is not None
    assert asks.channels
    assert all(asks.channels)


def test_an_analysis_that_says_nothing_asks_for_the_channels_of_its_run() -> None:
    friction = dataclasses.replace(catalogue.load("friction"), asks=None)
    assert friction.foreign_need.channels == (("input_angle",), ("torque",))


@pytest.mark.parametrize("name", PROTOCOLS)
def test_every_protocol_has_a_short_form_that_can_be_planned(name: str) -> None:
    experiment = catalogue.load(name)
    assert experiment.short
    short = make_parameters(experiment.parameters, dict(experiment.short))
    assert list(experiment.plan(short, shipped_gear()))
