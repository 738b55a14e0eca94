"""The report as a page: complete, self-contained, safe against what files say, honest about what it may claim."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from experiments.result import Result
from experiments.truth import TruthRow
from rig.errors import RigError
from rig.report.page import render_report, write_report
from tests.rig import handmade

CREATED = "2024-03-02 09:00+01:00"
VOID = {"meta", "br", "link", "img", "hr", "input", "use", "path"}


class Page(HTMLParser):
    """Tags, ids, attributes and text of a page; `open_tags` is empty for one that is well nested."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.events: list[str] = []
        self.words: list[str] = []
        self.open_tags: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in VOID:
            self.open_tags.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("href", "src", "xlink:href"):
                self.links.append(value or "")
            if name.startswith("on"):
                self.events.append(name)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open_tags.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open_tags.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def page() -> Page:
    fits = [handmade.fit(), handmade.fit(result=handmade.kinematic_result())]
    truth = [("friction", TruthRow(handmade.friction_result().estimates["F_c"], 70.0))]
    return Page(render_report(fits, created=CREATED, truth=truth))


def test_the_page_is_well_nested_and_needs_nothing_else(page: Page) -> None:
    assert not page.open_tags
    assert len(page.ids) == len(set(page.ids))
    assert all(link.startswith(("#", "data:")) for link in page.links)
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.ids)
    assert not {"script", "link", "iframe", "object"} & set(page.tags)


def test_what_a_laboratory_looks_for_is_there(page: Page) -> None:
    wanted = [
        "TEST REPORT", "SN-0815", "A. Example", "PASS", "87.3 ± 2.5 mN m", "The bracket drifted by 1.2 % over the sweep.",
        "70.3", "68.5 … 72.1", "weakly", "does not move", "torque scale (B)", "ab" * 32, "R-000042", "energy",
        "24.0 to 26.2 °C", "60 to 3 000 r/min, both directions", "Harmonic Grease SK-1A", "Load inertia J_o",
        "Hysteresis loss, lost motion, static torsional stiffness", "Transmission accuracy", "95 % interval",
        "Found against the simulator's truth", "1 of 1 true values lie in the 95 % interval", "Coulomb friction F_c",
        "harmonic-rig", "Torque per speed", "needs a velocity-steps run",
    ]  # fmt: skip
    assert [w for w in wanted if w not in page.text] == []


def test_a_simulated_run_is_marked_everywhere_and_cannot_be_signed(page: Page) -> None:
    assert page.text.count("SIMULATED") >= 3 + 3
    assert "signature on it" in page.text
    assert "Approved by" not in page.text


def test_a_hardware_run_can_be_signed_and_carries_no_mark() -> None:
    shown = Page(render_report([handmade.fit("hardware")], created=CREATED)).text
    assert "Approved by: name, date, signature" in shown
    assert not any(word in shown for word in ("SIMULATED", "REPLAY", "IMPORTED"))


def test_one_run_from_elsewhere_takes_the_signature_away() -> None:
    fits = [handmade.fit("hardware"), handmade.fit("imported", handmade.kinematic_result())]
    shown = Page(render_report(fits, created=CREATED)).text
    assert "Approved by" not in shown
    assert "runs marked IMPORTED" in shown


@pytest.mark.parametrize(
    ("limit", "provenance", "word"),
    [(0.15, "catalogue", "PASS"), (0.08, "catalogue", "FAIL"), (0.088, "catalogue", "MARGINAL"),
     (0.15, "recalled", "NOT JUDGED"), (0.01, "assumed", "NOT JUDGED")],
)  # fmt: skip
def test_the_verdict_stands_at_the_top(limit: float, provenance: str, word: str) -> None:
    text = render_report([handmade.fit(result=handmade.friction_result(limit, provenance))], created=CREATED)
    assert re.search(r'class="word" id="verdict">([A-Z ]+)<', text)[1] == word  # type: ignore[index]
    if word == "NOT JUDGED":
        assert "no verified limit" in text


def test_nothing_judged_is_not_called_a_pass() -> None:
    text = render_report([handmade.fit(result=handmade.kinematic_result())], created=CREATED)
    assert ">NOT JUDGED<" in text
    assert ">PASS<" not in text.replace("<td>PASS</td>", "")


@pytest.mark.parametrize("outcome", ["ABORTED", "TRIPPED", "ERROR", "INTERRUPTED"])
def test_an_unfinished_run_is_incomplete_whatever_its_numbers(outcome: str) -> None:
    text = render_report([handmade.fit("hardware", outcome=outcome)], created=CREATED)
    assert ">INCOMPLETE<" in text
    assert "Approved by" not in text


def test_hostile_names_inject_nothing() -> None:
    evil = "</title></style><script>alert(1)</script><img src=x onerror=alert(2)>\"'{{ 7*7 }}"
    fit = handmade.fit(gear_serial=evil, operator=evil, conditions={evil: evil}, parameters={evil: evil}, title=evil)
    gear = replace(fit.gear, name=evil)
    result = replace(fit.result, warnings=(evil,), run=evil)
    fit = replace(fit, gear=gear, result=result, recording=replace(fit.recording, metadata=replace(
        fit.recording.metadata, gear=gear, run_id=evil, sha256=evil)))  # fmt: skip
    found = Page(render_report([fit], created=evil, note=evil))
    assert "script" not in found.tags
    assert "img" not in found.tags
    assert found.events == []
    assert "{{ 7*7 }}" in found.text
    assert not found.open_tags


def test_the_same_fits_give_the_same_bytes(tmp_path: Path) -> None:
    first = write_report([handmade.fit()], tmp_path / "a" / "report.html", created=CREATED)
    second = write_report([handmade.fit()], tmp_path / "b.html", created=CREATED)
    assert first.read_bytes() == second.read_bytes()


def test_another_result_has_another_number() -> None:
    numbers = [
        re.search("HR-[0-9A-F]{10}", render_report([handmade.fit(sha256=sha)], created=CREATED))
        for sha in ("aa" * 32, "bb" * 32)
    ]
    assert numbers[0][0] != numbers[1][0]  # type: ignore[index]


def test_nothing_to_report_is_refused() -> None:
    with pytest.raises(RigError, match="nothing to report"):
        render_report([], created=CREATED)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RigError, match=r"report\.html"):
        write_report([handmade.fit()], tmp_path / "file" / "report.html", created=CREATED)


def test_a_result_without_anything_makes_a_page() -> None:
    bare = handmade.fit("imported", Result("R-1", "motion", {}), gear_serial="", operator="", start_time="", sha256="")
    shown = Page(render_report([replace(bare, gear_known=False)], created=CREATED)).text
    assert "Harmonic drive CSF" not in shown
    assert "not stated" in shown
    assert "IMPORTED" in shown
