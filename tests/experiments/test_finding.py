"""A finding is worded, ordered and written as JSON in one way."""

from __future__ import annotations

import json

from experiments.finding import Finding, Severity, first_blocking, passed_if


def test_a_sentence_tells_what_to_do_only_where_something_is_to_be_done() -> None:
    open_guard = Finding("guard", Severity.BLOCKS, "open (input 0x0)", "Close it.")
    assert open_guard.sentence == "guard: open (input 0x0). Close it."
    closed = Finding("guard", Severity.PASSED, "closed (input 0x8)", "Close it.")
    assert closed.sentence == "guard: closed (input 0x8)"


def test_what_passed_needs_no_remedy() -> None:
    assert passed_if("zero", True, "1 mN m", "Trim it.").remedy == ""
    assert passed_if("zero", False, "9 mN m", "Trim it.").remedy == "Trim it."
    assert passed_if("zero", False, "9 mN m").severity is Severity.BLOCKS
    assert passed_if("zero", False, "9 mN m", otherwise=Severity.WARNS).severity is Severity.WARNS


def test_only_what_blocks_blocks_and_the_first_is_named() -> None:
    harmless = [Finding("x", severity) for severity in Severity if severity != "blocks"]
    assert len(harmless) == 4
    assert first_blocking(harmless) is None
    two = [Finding("first", Severity.BLOCKS), Finding("second", Severity.BLOCKS)]
    assert first_blocking([*harmless, *two]) == two[0]


def test_the_json_form_holds_everything() -> None:
    finding = Finding(
        "rate",
        Severity.WARNS,
        "940 Hz of 1000 Hz",
        "A lower SYNC rate.",
        where="acquisition",
        allowed=">= 990 Hz",
        value=940.0,
        unit="Hz",
    )
    told = json.loads(json.dumps(finding.as_json()))
    told["severity"] = Severity(told["severity"])
    assert Finding(**told) == finding
