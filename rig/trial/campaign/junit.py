"""A campaign as JUnit XML, which every CI shows: its runs as one suite, the limits of its gear as another."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as xml

from rig.errors import RigError

if TYPE_CHECKING:
    from rig.trial.campaign.conduct import CampaignReport


def write_junit(report: CampaignReport, path: Path, *, require_verdict: bool = False) -> None:
    """Write the suites. A run that did not come to its end is an error, FAIL a failure.

    MARGINAL and NOT JUDGED are skipped, each with its reason; with `require_verdict` NOT JUDGED is a failure.
    Raises `RigError` where nothing can be written.
    """
    root = xml.Element("testsuites", name=f"campaign {report.walk.plan.name}")
    _runs(root, report)
    _limits(root, report, require_verdict=require_verdict)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        xml.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise RigError(
            f"the JUnit file cannot be written: {error.strerror or error}", where=str(path)
        ) from error


def _runs(root: xml.Element, report: CampaignReport) -> None:
    suite = xml.SubElement(root, "testsuite", name="runs")
    crashed = {one.run.name: one.crashed for one in report.analysed if one.crashed}
    missing = 0
    for index, stage in enumerate(report.walk.stages):
        protocol = stage.order.protocol
        case = xml.SubElement(suite, "testcase", classname="runs", name=protocol)
        done = report.journal.newest(index)
        if done is None or not done.counts:
            missing += 1
            message = "not run" if done is None else f"{done.outcome} {done.message}".strip()
            xml.SubElement(case, "error", message=_printable(message))
        elif done.run in crashed:
            missing += 1
            xml.SubElement(case, "error", message=_printable(crashed[done.run]))
    _count(suite, len(report.walk.stages), errors=missing)


def _limits(root: xml.Element, report: CampaignReport, *, require_verdict: bool) -> None:
    suite = xml.SubElement(root, "testsuite", name="limits")
    failing = {"FAIL", "NOT JUDGED"} if require_verdict else {"FAIL"}
    failed = skipped = 0
    for line in report.verdict.lines:
        case = xml.SubElement(suite, "testcase", classname="limits", name=_printable(line.name))
        why = _printable(f"{line.outcome}: {line.because or _REASON[line.outcome]}")
        if line.outcome in failing:
            failed += 1
            xml.SubElement(case, "failure", message=why)
        elif line.outcome != "PASS":
            skipped += 1
            xml.SubElement(case, "skipped", message=why)
    _count(suite, len(report.verdict.lines), failures=failed, skipped=skipped)


_REASON = {
    "PASS": "",
    "FAIL": "breaks its limit",
    "MARGINAL": "the limit is neither kept nor broken for certain",
    "NOT JUDGED": "nothing is known of it",
}
"""Why a line has its outcome, where it does not say so itself."""


def _count(suite: xml.Element, tests: int, **counts: int) -> None:
    for name, count in {
        "tests": tests,
        "failures": 0,
        "errors": 0,
        "skipped": 0,
        **counts,
    }.items():
        suite.set(name, str(count))


def _printable(text: str) -> str:
    """The text without what XML cannot hold."""
    return "".join(c if c.isprintable() else " " for c in text)
