"""What a test protocol is: one validated parameter model, a plan, an analysis."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

from experiments.errors import PlanError
from experiments.finding import Finding
from experiments.need import Need
from experiments.quantity import Quantity
from experiments.setting import Setting
from experiments.shape import Shape
from experiments.terms import PaperFigure, Term

if TYPE_CHECKING:
    from experiments.recording import Recording
    from experiments.result import Result
    from experiments.steps.vocabulary import Step
    from model.gear import HarmonicDrive


@dataclass(frozen=True)
class Deferred:
    """A function of a protocol by its place, "module:name"; the module is imported when the function is called.

    What a protocol declares is asked for by whoever lists, judges or describes; what it computes with takes seconds to
    import.
    """

    place: str

    @cached_property
    def function(self) -> Callable[..., Any]:
        """The function itself, its module imported now."""
        module, _, name = self.place.partition(":")
        return getattr(import_module(module), name)

    def __call__(self, *given: Any, **named: Any) -> Any:
        """What the function makes of this."""
        return self.function(*given, **named)


@dataclass(frozen=True)
class Evidence:
    """What an analysis may lean on besides the recording.

    `gear` is the parameter set to compare with (and the source of everything that is not
    identified); `tare` the result of a motor-tare run of the same rig, if there is one, and
    `tare_recording` that run; `other_tares` the results of the bench's other runs of that kind with
    the same motor and torque channel, which bear witness of it; `maximum_missed_share` the share of
    incomplete cycles above which a run is refused; `settings` what an analysis offers to choose
    (each names its own and refuses others); `checks` what was looked at of the recording before
    (`experiments.evidence.table`).
    """

    gear: HarmonicDrive
    tare: Result | None = None
    maximum_missed_share: float = 0.001
    settings: dict[str, Any] = field(default_factory=dict[str, Any])
    tare_recording: Recording | None = None
    checks: tuple[Finding, ...] = ()
    other_tares: tuple[Result, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A protocol. `parameters` is a frozen dataclass whose annotations are the only definition of
    flags, form and ranges.

    `plan(parameters, gear)` yields steps and is pure; `analyse(recording, evidence)` returns a
    `Result`. `gear_mounted` is False for protocols that run the bare motor. `compare(recording,
    gear, evidence)` scores given parameters on a run without fitting any; `identified(result,
    gear)` is the gear with what the analysis identified written into it. Both are None where a
    protocol has nothing of the kind. `has_plan` is False for analyses of recordings only.

    These functions are named by their place (`Deferred`) where what they compute with takes long to import.

    `quantities` are all that its analysis and its comparison may return, the most important first.
    `live` names the plots of a run that is under way: torque below speed, row by row. `setpoint` is
    what its segments are set to: speeds of the input [rad/s], torques [N m] or wave-generator
    angles [rad]. `gives_tare` is a result that may be subtracted from those that have `takes_tare`;
    `builds_on` names the protocols without whose identified parameters its analysis is poorer; `learns` makes of the
    results of a gear's other runs of this protocol settings of its analysis, for whoever gives none by hand.
    `terms` are those that a reader of its results needs, `figures` the paper's that its run draws.
    `asks` is what the analysis needs of a recording that was made elsewhere: the channels of `needs`, where it does
    not say more. `short` are parameters with which its run is short, for teaching and load tests, with wider
    uncertainties.
    `settings` are what its analysis lets a user choose.
    `shapes` are the curves that it lays through the points of a run: a plan says beforehand where they are too few.
    `cuts_gaps` is an analysis that uses the stretches between gaps of time and draws nothing across them.
    `refuse_gear(parameters, serial)` raises `PlanError` where the parameters are for another gear than is mounted.
    `goes_on` is the command that goes on from its run, with {run} for the file.
    `version` of the analysis is raised whenever the same recording gives other numbers.
    """

    name: str
    title: str
    summary: str
    parameters: type[Any]
    plan: Callable[[Any, HarmonicDrive], Iterator[Step]]
    analyse: Callable[[Recording, Evidence], Result]
    needs: tuple[str, ...] = ("input_angle", "output_angle", "torque")
    gear_mounted: bool = True
    compare: Callable[[Recording, HarmonicDrive, Evidence], Result] | None = None
    identified: Callable[[Result, HarmonicDrive], HarmonicDrive] | None = None
    has_plan: bool = True
    cuts_gaps: bool = False
    goes_on: str = ""
    refuse_gear: Callable[[Any, str], None] | None = None
    quantities: tuple[Quantity, ...] = ()
    version: int = 1
    live: tuple[str, ...] = ("speed", "wave", "torque", "temperature")
    setpoint: Literal["speed", "torque", "position"] = "speed"
    gives_tare: bool = False
    takes_tare: bool = False
    builds_on: tuple[str, ...] = ()
    learns: Callable[[Sequence[Result]], Mapping[str, Any]] | None = None
    terms: tuple[Term, ...] = ()
    figures: tuple[PaperFigure, ...] = ()
    shapes: tuple[Shape, ...] = ()
    asks: Need | None = None
    short: Mapping[str, Any] = field(default_factory=dict[str, Any])
    settings: tuple[Setting, ...] = ()

    @property
    def foreign_need(self) -> Need:
        """What the analysis needs of a recording that was made elsewhere."""
        return self.asks or Need(channels=tuple((name,) for name in self.needs))


@dataclass(frozen=True)
class NoParameters:
    """The parameter model of an analysis that moves nothing."""


def no_plan(parameters: object, gear: HarmonicDrive) -> Iterator[Step]:
    """The plan of an analysis that needs none: always refused."""
    raise PlanError(
        "this is an analysis of recordings, it cannot be planned or run",
        where="protocol",
        remedy="Use it as a kind of `rig fit`.",
    )
