"""Terms by which a reader understands results, and figures of the paper: what several protocols share, once."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Term:
    """A term of a report and its definition."""

    term: str
    definition: str


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper that a protocol's run draws anew: its number, and what it shows."""

    number: int
    shows: str


KINEMATIC_ERROR = Term(
    "Kinematic error",
    "Difference between the output angle and the input angle divided by the ratio, as a function "
    "of the input angle. Positive means that the output leads in the direction of travel.",
)
NORMALISED_MSE = Term(
    "Normalised mean square error (MSE)",
    "Equation 22: 100 times the mean squared deviation of the fit over the variance of the "
    "measured curve. 100 is no better than the mean, below 5 is good, below 1 is excellent. It is "
    "computed on the curve averaged per bin of the input angle; the value on raw samples is given "
    "where it was computed.",
)
RUNNING_TORQUE = Term(
    "No-load running torque",
    "Torque that keeps the input turning at a defined constant speed with nothing on the output, "
    "averaged over whole wave-generator revolutions.",
)
MOTOR_AND_GEAR = Term(
    "Motor + gear",
    "The torque monitor shows the friction of motor and gear together. Only a tare (the same "
    "motor with the gear removed) separates them; without it the results are those of the pair.",
)
