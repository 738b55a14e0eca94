"""The definitions by which a report's quantities are to be read, and what a rig of this kind cannot measure."""

from __future__ import annotations

from collections.abc import Iterable

from experiments import catalogue
from experiments.result import DECISION_RULE
from experiments.terms import PaperFigure, Term
from rig.content.page import Section

_PAPER = (
    "Zou, Tao, Jiang, Mei, Wu: A harmonic drive model considering geometry and internal "
    "interaction. Proc IMechE Part C: "
    "Journal of Mechanical Engineering Science (2015), DOI 10.1177/0954406215621097"
)

COMMON = (
    Term(
        "Identifiable",
        "Whether the data can tell the parameter at all: “yes”; “weakly”, where the interval is wide or rests on an "
        "assumption; “no”, where the number must not be used.",
    ),
    Term(
        "Uncertainty",
        "Value ± U holds the true value with 95 %. U = k u, u from the budget: type A from the scatter of the data, "
        "type B from elsewhere (scales, zeros, encoders, tare); k from Student's t by the effective degrees of "
        "freedom. The statistical part is the 95 % interval of these data alone, at 20 °C with what brought it there.",
    ),
    Term(
        "Verdict",
        f"{DECISION_RULE} NOT JUDGED where no acceptance file is named, where nobody has confirmed the limit, where "
        "the quantity has no number, or where evidence is missing; the reason stands beside it. The verdict is the "
        "worst over all that the acceptance file lists: FAIL, NOT JUDGED, MARGINAL, PASS.",
    ),
)
"""Terms that every report needs; those of a kind of fit stand with its protocol."""

_NOT_MEASURED = (
    "Hysteresis loss, lost motion, static torsional stiffness, back-driving torque and "
    "efficiency under load: they need a "
    "locked input or a driven output with an output-torque sensor.",
    "The eccentricity of the output encoder apart from the gear's own error once per output revolution, and the motor "
    "encoder's errors once and twice per revolution apart from the gear's input orders 1 and 2: only their sums are "
    "measured. A second run with an encoder re-clocked would separate them.",
    "The stiffnesses of tooth mesh, bearing and cup one by one: only their combination shows at the output.",
)
"""What no analysis of these runs can give, whatever the data."""


def title_of(kind: str) -> str:
    """The heading of a kind of fit; its name where the catalogue does not have it."""
    experiment = catalogue.declared(kind)
    return kind if experiment is None else experiment.title


def _definitions_for(kinds: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """The definitions that a report on these kinds of fit needs, each once."""
    experiments = [catalogue.declared(kind) for kind in dict.fromkeys(kinds)]
    terms = [term for experiment in experiments if experiment for term in experiment.terms]
    return tuple((term.term, term.definition) for term in dict.fromkeys((*terms, *COMMON)))


def sections(
    kinds: Iterable[str], terms: Iterable[tuple[str, str]] = ()
) -> tuple[Section, Section]:
    """The end of every report: definitions (`terms` come first), and what this rig cannot measure."""
    return (
        Section(
            title="Definitions",
            anchor="definitions",
            terms=(*terms, *_definitions_for(kinds)),
            note=f"Equation and figure numbers are those of {_PAPER}.",
        ),
        Section(title="What this rig cannot measure", anchor="scope", items=_NOT_MEASURED),
    )


def paper_figures() -> list[tuple[PaperFigure, str]]:
    """The paper's figures in their order, each with the protocol whose run it is drawn from."""
    figures = [(figure, one.name) for one in catalogue.every() for figure in one.figures]
    return sorted(figures, key=lambda pair: pair[0].number)
