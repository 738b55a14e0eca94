"""What a test protocol is: one validated parameter model, a plan, an analysis."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from experiments.recording import Recording
from experiments.result import Result
from experiments.steps import Step
from model.gear import HarmonicDrive


@dataclass(frozen=True)
class Evidence:
    """What an analysis may lean on besides the recording.

    `gear` is the parameter set to compare with (and the source of everything that is not identified); `tare` the result of a
    motor-tare run of the same rig, if there is one; `maximum_missed_share` the share of incomplete cycles above which a run
    is refused.
    """

    gear: HarmonicDrive
    tare: Result | None = None
    maximum_missed_share: float = 0.001
    settings: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Experiment:
    """A protocol. `parameters` is a frozen dataclass whose annotations are the only definition of flags, form and ranges.

    `plan(parameters, gear)` yields steps and is pure; `analyse(recording, evidence)` returns a `Result`. `gear_mounted` is
    False for protocols that run the bare motor.
    """

    name: str
    title: str
    summary: str
    parameters: type[Any]
    plan: Callable[[Any, HarmonicDrive], Iterator[Step]]
    analyse: Callable[[Recording, Evidence], Result]
    needs: tuple[str, ...] = ("input_angle", "output_angle", "torque")
    gear_mounted: bool = True
