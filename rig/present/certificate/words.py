"""The sentences of a certificate in the language of its reader, from a table a language (`languages/*.toml`).

A laboratory names one in `[laboratory] language`: one that ships (`en`, `de`, `ja`), or a file of its own beside the
description. What a table lacks falls back to English. The code of a verdict and of an origin (PASS, SIMULATED ...)
stands behind its word wherever that is another: no table can make a FAIL read as something else.
"""

from __future__ import annotations

import functools
import re
import string
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from rig.errors import ConfigurationError
from rig.extras import require

SHIPPED: Final = ("en", "de", "ja")
"""Languages that come with the program; the first is the one to which the others fall back."""
_FONT_PACKAGE: Final = "matplotlib_fontja"
"""The package with the typeface of the Japanese table (IPAexGothic)."""
_OWN: Final = frozenset({"decimal", "fonts", "font_folder", "names"})
"""What a table says beside sentences: the decimal mark, its typefaces, and what else stands on the pages."""
_POINT: Final = re.compile(r"(?<=\d)\.(?=\d)")


@dataclass(frozen=True)
class Words:
    """One language: `words.RULE` is a sentence of its table, in English where the table has none.

    `names` says what else stands on the pages (quantities, tests, instruments) in this language; `missing` are the
    sentences that fell back.
    """

    language: str
    said: Mapping[str, Any] = field(repr=False)
    names: Mapping[str, str] = field(default_factory=dict, repr=False)
    decimal: str = "."
    fonts: tuple[str, ...] = ()
    """Typefaces beside those of the page, for letters that it has not."""
    font_folder: Path | None = field(default=None, repr=False)
    missing: tuple[str, ...] = field(default=(), repr=False)

    def __getattr__(self, name: str) -> Any:
        if not name.isupper():
            raise AttributeError(name)
        return self.said[name.lower()]

    def name(self, text: str) -> str:
        """What is called so in English; itself where this language has no word for it."""
        return self.names.get(text, text)

    def named(self, text: str) -> str:
        """A text whose parts, by commas, semicolons and brackets, are called as this language calls them; its numbers
        with the decimal mark.
        """
        whole = self.names.get(text)
        if whole is not None:
            return self.numbers(whole)
        for english in sorted(self.names, key=len, reverse=True):
            if english in text:
                own = self.names[english]
                text = re.sub(rf"(?<!\w){re.escape(english)}(?!\w)", lambda _, own=own: own, text)
        return self.numbers(text)

    def numbers(self, text: str) -> str:
        """A text of numbers with the decimal mark of this language."""
        return _POINT.sub(self.decimal, text)

    def font_files(self) -> tuple[Path, ...]:
        """The files of its typefaces. Raises `RigError` where there are none."""
        if not self.fonts:
            return ()
        if self.language in SHIPPED:
            require(f"a certificate in the language {self.language}", self.language, _FONT_PACKAGE)
        found = () if self.font_folder is None else tuple(sorted(self.font_folder.glob("*.[ot]tf")))
        if not found:
            raise ConfigurationError(
                "the typefaces of this language are not there",
                where="laboratory.language",
                value=f"{', '.join(self.fonts)} in {self.font_folder}",
                limit="one .ttf or .otf file at least",
                remedy="Put them into that folder, and name it `font_folder` in the file of sentences.",
            )
        return found

    def coded(self, table: Mapping[str, str], code: str) -> str:
        """The word for a code with the code behind it, where it is another."""
        word = table.get(code, code)
        return word if word == code else f"{word} ({code})"


@functools.cache
def _table(language: str) -> Mapping[str, Any]:
    name = f"languages/{language}.toml"
    text = resources.files("rig.present.certificate").joinpath(name).read_text(encoding="utf-8")
    return tomllib.loads(text)


def words_of(language: str = "en", folder: Path | None = None) -> Words:
    """The words of a language that ships, or of a file beside the description in `folder`.

    Raises `ConfigurationError` for a language that there is not, a file that cannot be read, and a sentence that is
    none of ours or lacks what must stand in it.
    """
    if language in SHIPPED:
        spec = find_spec(_FONT_PACKAGE)
        place = None if spec is None or spec.origin is None else Path(spec.origin).parent / "fonts"
        return _words(language, _table(language), place)
    path = (folder or Path()) / language
    try:
        told = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigurationError(
            "no such language",
            where="laboratory.language",
            value=f"{language!r}: {error}",
            limit=f"{', '.join(SHIPPED)}, or a file of sentences (TOML) beside the description",
        ) from None
    _refuse_wrong(told, str(path))
    return _words(language, told, path.parent / str(told.get("font_folder", "")))


def _words(language: str, told: Mapping[str, Any], font_folder: Path | None) -> Words:
    english = _table(SHIPPED[0])
    said: dict[str, Any] = {}
    missing: list[str] = []
    for name, usual in english.items():
        if name in _OWN:
            continue
        said[name] = told.get(name, usual)
        if isinstance(usual, dict):
            own = told.get(name) or {}
            missing += [f"{name}.{key}" for key in usual if key not in own]
            said[name] = {**usual, **own}
        elif name not in told:
            missing.append(name)
    return Words(
        language=language,
        said=said,
        names=dict(told.get("names", {})),
        decimal=str(told.get("decimal", ".")),
        fonts=tuple(told.get("fonts", ())),
        font_folder=font_folder,
        missing=tuple(missing),
    )


def _refuse_wrong(told: Mapping[str, Any], where: str) -> None:
    """Refuse a table with sentences that are none of ours, or that lack what must stand in them."""
    english = _table(SHIPPED[0])
    for name, own in told.items():
        if name in _OWN:
            continue
        usual = english.get(name)
        if usual is None or type(own) is not type(usual):
            raise _wrong("is no sentence of a certificate", f"{where}: {name}", ", ".join(english))
        if isinstance(usual, list):
            if len(own) != len(usual):
                raise _wrong("has another number of words", f"{where}: {name}", str(len(usual)))
            continue
        pairs = [(own, usual, name)]
        if isinstance(usual, dict):
            unknown = sorted(set(own) - set(usual))
            if unknown:
                raise _wrong(
                    "is no word of this table", f"{where}: {name}.{unknown[0]}", ", ".join(usual)
                )
            pairs = [(own[key], usual[key], f"{name}.{key}") for key in own]
        for text, model, key in pairs:
            if not str(text).strip() or fields_of(str(text)) != fields_of(model):
                limit = (
                    " ".join(f"{{{one}}}" for one in sorted(fields_of(model))) or "text without {}"
                )
                raise _wrong("must say what the English sentence says", f"{where}: {key}", limit)


def _wrong(what: str, where: str, limit: str) -> ConfigurationError:
    return ConfigurationError(what, where=where, limit=limit)


def fields_of(sentence: str) -> frozenset[str]:
    """What stands in braces in a sentence; a broken brace is a field of its own, which no sentence has."""
    try:
        return frozenset(
            name for _, name, _, _ in string.Formatter().parse(sentence) if name is not None
        )
    except ValueError:
        return frozenset({"{"})


ENGLISH: Final = words_of()
