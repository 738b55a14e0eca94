"""A certificate in the customer's language: nothing missing, nothing that reads as something else."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from experiments import catalogue
from experiments.finding import Severity
from experiments.quantity import Quantity
from rig.errors import ConfigurationError, RigError
from rig.gears.acceptance import acceptance_named
from rig.main import app
from rig.present import definitions
from rig.present.certificate import words as table
from rig.present.certificate.laboratory import laboratory_of
from rig.present.certificate.verify import verify_certificate
from rig.present.certificate.words import ENGLISH, SHIPPED, fields_of, words_of
from rig.present.certificate.write import Certificate, write_certificate
from tests.rig.present.certificate.certified_gear import LABORATORY, gear, printed, sheets_in
from tests.rig.present.test_paper import squeezed

OTHERS = SHIPPED[1:]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gear(tmp_path_factory.mktemp("whole"))


@pytest.mark.parametrize("language", SHIPPED)
def test_no_sentence_of_a_language_that_ships_is_missing_or_lacks_what_stands_in_it(
    language: str,
) -> None:
    words = words_of(language)
    assert words.missing == ()
    own, english = table._table(language), table._table("en")
    table._refuse_wrong(own, language)
    same = [key for key, text in own.items() if text == english.get(key)]
    assert language == "en" or not set(same) - {"decimal"}


def key_headings() -> set[str]:
    declared = [catalogue.declared(name) for name in catalogue.names()]
    keys: list[Quantity] = [q for one in declared if one for q in one.quantities if q.is_key]
    return {quantity.headed(quantity.name) for quantity in keys} - {"Figure 16 phase difference"}


@pytest.mark.parametrize("language", OTHERS)
def test_every_test_and_key_quantity_has_a_name(language: str) -> None:
    words = words_of(language)
    for kind in catalogue.names():
        assert definitions.title_of(kind) in words.names, kind
    for heading in key_headings():
        begin = heading.partition("{")[0].strip(" ,")
        assert words.named(begin) != begin, heading


def certified(whole: Path, language: str, folder: Path) -> Certificate:
    laboratory = replace(LABORATORY, words=words_of(language))
    acceptance = acceptance_named(str(whole / "spec.toml"))
    outputs = [folder / "c.pdf", folder / "c.html"]
    return write_certificate(whole, "A1", outputs, acceptance=acceptance, laboratory=laboratory)


@pytest.mark.parametrize("language", OTHERS)
def test_two_pages_say_it_and_verify_as_the_english_ones_do(
    language: str, whole: Path, tmp_path: Path
) -> None:
    written = certified(whole, language, tmp_path)
    words = words_of(language)
    record = json.loads(written.record.read_text(encoding="utf-8"))
    assert (record["language"], record["title"], written.title) == (language, *["SIMULATION"] * 2)
    found = {one.what: one.severity for one in verify_certificate(tmp_path / "c.pdf")}
    assert Severity.BLOCKS not in found.values()
    pages = printed(sheets_in(whole, laboratory=replace(LABORATORY, words=words)))
    assert len(pages) == 2
    first, second = map(squeezed, pages)
    assert squeezed(words.coded(words.VERDICTS, "PASS")) in first
    assert squeezed(written.sentence) in first
    for text in (words.RULE, words.COVERAGE, words.SCOPE.format(kind=words.KINDS["simulation"])):
        assert squeezed(text) in second
    assert not any(squeezed(text) in first + second for text in (ENGLISH.RULE, ENGLISH.COVERAGE))


def test_numbers_have_the_decimal_mark_of_the_language(whole: Path) -> None:
    german = sheets_in(whole, laboratory=replace(LABORATORY, words=words_of("de")))
    english = sheets_in(whole)
    for own, usual in zip(german.front.values.rows, english.front.values.rows, strict=True):
        assert own[1] == usual[1].replace(".", ",")
    assert "." in "".join(row[1] for row in english.front.values.rows)
    svg = "".join(picture.svg for picture in german.front.pictures)
    assert ">0,5<" in svg
    assert ">0.5<" not in svg


def test_a_verdict_keeps_its_code_whatever_a_table_calls_it(whole: Path, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text('[verdicts]\nPASS = "x"\nFAIL = "PASS"\n', "utf-8")
    words = words_of("own.toml", tmp_path)
    assert words.coded(words.VERDICTS, "FAIL") == "PASS (FAIL)"
    assert words.coded(words.MARKS, "SIMULATED") == "SIMULATED"
    sheets = sheets_in(whole, laboratory=replace(LABORATORY, words=words))
    assert sheets.front.verdict == "x (PASS)"


def test_what_a_file_lacks_stands_there_in_english_and_is_counted(tmp_path: Path) -> None:
    text = 'limit = "límite"\ndecimal = ","\n[titles]\nreport = "INFORME"\n'
    (tmp_path / "es.toml").write_text(text, encoding="utf-8")
    words = words_of("es.toml", tmp_path)
    assert (words.LIMIT, words.RULE, words.TITLES["report"]) == ("límite", ENGLISH.RULE, "INFORME")
    assert "limit" not in words.missing
    assert {"rule", "titles.certificate", "verdicts.PASS"} <= set(words.missing)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ('verdict = "El reductor {serial}"', "verdict"),
        ('verdict = "{serial} {words} {more}"', "verdict"),
        ('rule = ""', "rule"),
        ('made_by = "{program"', "made_by"),
        ('no_such = "x"', "no_such"),
        ('facts = ["Cliente"]', "facts"),
        ("rule = 5", "rule"),
        ('[verdicts]\nSURE = "x"', "verdicts.SURE"),
        ('[counted]\nFAIL = "no cumple"', "counted.FAIL"),
    ],
)
def test_a_sentence_that_does_not_say_what_the_english_one_says_is_refused(
    text: str, where: str, tmp_path: Path
) -> None:
    (tmp_path / "es.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=rf"{where}"):
        words_of("es.toml", tmp_path)


@pytest.mark.parametrize("language", ["fr", "none.toml", "../de"])
def test_a_language_that_there_is_not_is_refused_by_name(language: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"laboratory\.language"):
        words_of(language, tmp_path)


def test_letters_without_a_typeface_are_told_with_the_extra(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.extras.find_spec", lambda name: None)
    with pytest.raises(RigError, match=r"harmonic-rig\[ja\]"):
        certified(whole, "ja", tmp_path)
    (tmp_path / "zh.toml").write_text('fonts = ["Nowhere"]\nfont_folder = "fonts"\n', "utf-8")
    with pytest.raises(ConfigurationError, match="typefaces of this language are not there"):
        words_of("zh.toml", tmp_path).font_files()


def test_the_description_of_the_rig_names_the_language(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text('[laboratory]\nname = "Labor"\nlanguage = "de"\n', encoding="utf-8")
    assert laboratory_of(path).words.TITLES["report"] == "PRÜFBERICHT"
    order = ["certificate", "--gear", "A1", "--runs", str(whole), "--config", str(path)]
    order += ["--acceptance", str(whole / "spec.toml"), "-o", str(tmp_path / "c.html")]
    ran = CliRunner().invoke(app, order)
    assert ran.exit_code == 0, ran.output
    page = (tmp_path / "c.html").read_text(encoding="utf-8")
    assert '<html lang="de">' in page
    assert "ERFÜLLT (PASS)" in page


@pytest.mark.parametrize(
    ("text", "fields"), [("a {b} {c}", {"b", "c"}), ("plain", set()), ("{", {"{"})]
)
def test_what_stands_in_braces(text: str, fields: set[str]) -> None:
    assert fields_of(text) == frozenset(fields)
