"""Every sentence of a certificate in one place, in English: what stands on its two pages and is not a name or a number.

A certificate of another language has another table like this one, and nothing else.
"""

from __future__ import annotations

from typing import Final

TITLES: Final = {
    "certificate": "CERTIFICATE",
    "report": "TEST REPORT",
    "simulation": "SIMULATION",
}
UNTRACEABLE: Final = "not traceable: {reasons}"
NO_CERTIFICATE: Final = "no certificate"
OVERDUE: Final = "was due {due}"
ANOTHER_ORIGIN: Final = {
    "replay": "a recorded run played back",
    "imported": "a recording of another rig",
}
NOT_STATED: Final = "not stated"
NOT_LISTED: Final = "not listed"
"""What stands in the place of a verdict where the acceptance file says nothing of a quantity."""
COUNTED: Final = {
    "PASS": "keeps all {all} limits of the acceptance file {name}",
    "MARGINAL": "breaks none of the {all} limits of the acceptance file {name} for certain, "
    "but does not keep {bad} of them for certain",
    "FAIL": "breaks {bad} of the {all} limits of the acceptance file {name}",
}
VERDICT: Final = "The gear {serial} {words}."
NOT_JUDGED: Final = "The gear {serial} is not judged: {because}."
NOTHING_HELD: Final = "nothing was held against a limit"
INCOMPLETE: Final = "INCOMPLETE: no analysed run of {missing}."
MORE_LIMITS: Final = "{count} more limits ({outcomes}) stand in {record}."
MORE_REASONS: Final = "{count} more stand in the report."
OF_VALUES: Final = "U (95 %) = k u; ν: degrees of freedom."
SOURCE: Final = "Source {mark}: {source}."
ONE_SOURCE: Final = "Limits: {source}."
ITEM: Final = "Harmonic drive {name}, serial number {serial}, ratio {ratio}, {mounting}"
UNKNOWN_GEAR: Final = "of a type that nobody stated"

ERROR_TITLE: Final = (
    "Error over one output turn, fitted; brackets: peak to peak, encoders included."
)
ERROR_AXIS: Final = "error [arcmin]"
ANGLE_AXIS: Final = "output angle [°]"
TORQUE_TITLE: Final = "No-load running torque over speed, points as measured{tare}."
TORQUE_TARE: Final = ", motor tare subtracted"
TORQUE_AXIS: Final = "torque of {subject} [mN m]"
SPEED_AXIS: Final = "input speed [r/min]"
PEAK_TO_PEAK: Final = "peak to peak"
LIMIT: Final = "limit"
LIMIT_AT_REFERENCE: Final = "limit at 20 °C"
FORWARD: Final = "forward"
REVERSE: Final = "reverse"

FACTS: Final = ("Customer", "Order", "Item")
LUBRICANT: Final = "Lubricant"
HOURS: Final = "Hours before the test"
WARM_UP: Final = "Warm-up"
NO_WARM_UP: Final = "none recorded"
AMBIENT: Final = "Ambient"
METHOD: Final = "Method"
PROTOCOLS: Final = "protocols of the program: {protocols}"
DEVIATIONS: Final = "Deviations from it"
NO_DEVIATIONS: Final = "none stated"
RULE_NAME: Final = "Decision rule"
RULE: Final = (
    "guarded acceptance, guard band U (JCGM 106:2012). PASS: the whole of value ± U keeps the limit. FAIL: the whole "
    "of it breaks the limit. MARGINAL: the limit lies inside. Risk at the limit: a value that is just accepted, or "
    "just rejected, lies on the other side of its limit with a probability of at most 2.5 %."
)
COVERAGE_NAME: Final = "Uncertainty"
COVERAGE: Final = (
    "U is the expanded uncertainty: the interval value ± U is taken to contain the true value with a probability of "
    "about 95 %. U is the standard uncertainty times the k that stands beside it; k follows from the degrees of "
    "freedom (JCGM 100:2008)."
)
HOLDS_AT: Final = "Every value holds at the temperature of its test; one that is named at 20 °C was brought to it."
CONDITIONS: Final = "Conditions"
INSTRUMENTS: Final = "Instruments"
REMARKS: Final = "Remarks"
RESTS_ON: Final = "Rests on"
HASH: Final = "the files listed in {manifest}, SHA-256 of that list:"
REPORT: Final = "All else is the report (rig report)."
SCOPE: Final = "This {kind} relates to this item only and may be copied only whole."
KINDS: Final = {
    "certificate": "certificate",
    "report": "test report",
    "simulation": "simulation",
}
SIGNED: Final = ("Tested", "Checked", "Approved")
SIGNATURE: Final = "name, date, signature"
PLACE: Final = "Place"
RECEIVED: Final = "Received"
TESTED: Final = "Tested"
ISSUED: Final = "Issued"
PAGE: Final = "page {page} of 2"
MADE_BY: Final = "Made by {program}."
