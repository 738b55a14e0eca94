"""A campaign as JUnit XML, which every CI shows: its runs as one suite, the limits of its gear as another."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as xml

from rig.errors import RigError

if TYPE_CHECKING:
    from rig.trial.campaign.conduct import CampaignReport


def write_junit(report: CampaignReport, path: Path) -> None:
    """Write the suites. A run that did not come to its end is an error, FAIL a failure, NOT JUDGED skipped.

    MARGINAL passes with its reason in the output. Raises `RigError` where nothing can be written.
    """
    root = xml.Element("testsuites", name=f"campaign {report.walk.plan.name}")
    _runs(root, report)
    _limits(root, report)
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


def _limits(root: xml.Element, report: CampaignReport) -> None:
    suite = xml.SubElement(root, "testsuite", name="limits")
    words = [line.outcome for line in report.verdict.lines]
    for line in report.verdict.lines:
        case = xml.SubElement(suite, "testcase", classname="limits", name=_printable(line.name))
        if line.outcome == "FAIL":
            xml.SubElement(case, "failure", message=_printable(line.because or "breaks its limit"))
        elif line.outcome == "NOT JUDGED":
            xml.SubElement(case, "skipped", message=_printable(line.because))
        elif line.outcome == "MARGINAL":
            text = line.because or "the limit lies inside the expanded uncertainty"
            xml.SubElement(case, "system-out").text = f"MARGINAL: {_printable(text)}"
    _count(suite, len(words), failures=words.count("FAIL"), skipped=words.count("NOT JUDGED"))


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
