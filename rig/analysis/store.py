"""The analysis store: what was found of a run lies beside it, one numbered file per analysis, appended, never edited.

`<run>.analysis/0001.json` is sealed as runs are (`0001.json.sha256` beside it) and checked whenever it is
read. It names the run and its tare by their SHA-256, the versions of program and
analysis, the parameter set and the settings that were used, and holds the result as `rig fit
--json` prints it, what each of its numbers is, and the covariance of what was fitted together. Its
figures lie beside it, packed, under a name made of their content. The run file itself is never
touched. Analyses of format 1 are read as if they were of format 2. Those of formats 1 and 2, which
version 0.2.0 and earlier ones wrote, were not sealed: they are read, and told as `NOT_SEALED_THEN`.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from experiments.catalogue import extension_of
from experiments.quantity import Quantity, quantity_of
from experiments.result import Result, checks_to_mapping
from rig.analysis import format_1
from rig.analysis.number_or_none import finite
from rig.analysis.result_data import (
    covariance_from_mapping,
    declared_quantities,
    plot_from_mapping,
    plot_to_mapping,
    result_from_mapping,
    table_to_mapping,
)
from rig.errors import ChangedRunError, RunFileError
from rig.program import extension_records, this_program
from rig.runfile.seal import Seal, is_unsealed_allowed, unsealed
from rig.runfile.sealed import read_sealed, write_sealed

STORE_FORMAT = "harmonic-rig-analysis-3"
"""Sealed from birth: without its note an analysis that says so of itself is refused."""
FORMAT_2 = "harmonic-rig-analysis-2"
"""The same but for the seal: what version 0.2.0 wrote."""
NOT_SEALED_THEN = "not sealed (0.2.0)"
"""What is told in the place of the hash of an analysis that was made before analyses were sealed."""
_NUMBER = re.compile(r"(\d{4,})\.json\Z")
_FIGURES = re.compile(r"figures-[0-9a-f]{16}\.json\.gz")
NO_FIGURES = "The version that made this analysis kept no figures: `rig fit` makes them."


@dataclass(frozen=True)
class Analysis:
    """One stored analysis: its number, its file, and what the file says."""

    number: int
    path: Path
    content: Mapping[str, Any]
    seal: Seal = field(default_factory=Seal)

    @property
    def seal_words(self) -> str:
        """The SHA-256 of its file; with the words that it is not sealed where nothing vouches for it."""
        if self.seal.is_whole:
            return self.seal.sha256
        return f"{self.seal.sha256}, {_not_sealed(self)}"

    @property
    def kind(self) -> str:
        """The kind of fit."""
        return str(self.content.get("kind", ""))

    @cached_property
    def result(self) -> Result:
        """The result with its tables, without covariance and figures. Raises `RunFileError` where it holds none."""
        try:
            return result_from_mapping(self.content["result"], self.content.get("tables", ()))
        except (KeyError, TypeError, ValueError) as error:
            raise self._without_result(error) from None

    @property
    def name(self) -> str:
        """The name by which it is told: folder and file."""
        return f"{self.path.parent.name}/{self.path.name}"

    @property
    def tare(self) -> Mapping[str, Any]:
        """The tare that was subtracted: its run, its SHA-256, its file, how it was chosen; empty without one."""
        return self.content.get("tare") or {}

    def whole_result(self) -> Result:
        """The result with its tables, its covariance and its figures, as the analysis returned it.

        Raises `RunFileError` for an analysis that holds none. One that was stored by a version that
        kept no figures says so among its warnings.
        """
        try:
            figures = self._figures()
            plots = tuple(plot_from_mapping(plot) for plot in figures or ())
            covariance = covariance_from_mapping(self.content.get("covariance"))
        except (OSError, EOFError, KeyError, TypeError, ValueError) as error:
            raise self._without_result(error) from None
        remarks = () if figures is not None else (NO_FIGURES,)
        warnings = (*self.result.warnings, *remarks)
        return replace(self.result, plots=plots, covariance=covariance, warnings=warnings)

    def _without_result(self, error: Exception) -> RunFileError:
        return RunFileError(
            "the stored analysis holds no result",
            where=str(self.path),
            value=str(error),
            remedy="Move it away and analyse the run again with `rig fit`.",
        )

    def _figures(self) -> list[Mapping[str, Any]] | None:
        name = str(self.content.get("figures", ""))
        if not name:
            return None
        # Only a name that this program gives: a file from elsewhere does not choose what is read.
        if not _FIGURES.fullmatch(name):
            raise ValueError(f"figures {name!r}")
        text = gzip.decompress((self.path.parent / name).read_bytes())
        if _figures_name(text) != name:
            raise ChangedRunError(
                "the figures of an analysis were changed since they were stored",
                where=str(self.path.parent / name),
                value=_figures_name(text),
                limit=name,
                remedy="Take the original, or the backup; or analyse the run again with `rig fit`.",
            )
        return json.loads(text)

    def quantity(self, name: str) -> Quantity:
        """What its protocol declares of an estimate; what was stored of one that it no longer declares."""
        quantity = quantity_of(declared_quantities(self.kind), name)
        if quantity is not None:
            return quantity
        stored = self.content["quantities"].get(name, {})
        return Quantity(
            name=name, title=str(stored.get("title", name)), unit=str(stored.get("unit", "1"))
        )


@dataclass(frozen=True)
class Basis:
    """What an analysis rests on besides the recording.

    `run_sha256` of the run file, `gear` the parameter set as a mapping, `gear_source` where it came from
    (`GearSource.as_json`), `tare` names run, SHA-256 and file of the motor tare and how it was chosen,
    `no_tare` says why there is none, `other_tares` names those that it was held against, `settings` what was
    asked for, `created` the calendar time (ISO 8601), `analysis_version` that of the kind of analysis
    (`Experiment.version`).
    """

    run_sha256: str
    created: str
    gear: Mapping[str, Any] = field(default_factory=dict)
    tare: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    analysis_version: int = 1
    gear_source: Mapping[str, Any] = field(default_factory=dict)
    no_tare: tuple[str, ...] = ()
    other_tares: tuple[Mapping[str, Any], ...] = ()


def _not_sealed(analysis: Analysis) -> str:
    """That nothing vouches for it, and whether the version that stored it sealed any."""
    return "not sealed" if analysis.content.get("format") == STORE_FORMAT else NOT_SEALED_THEN


def unsealed_words(analysis: Analysis) -> str:
    """What stands on every page of an analysis that nothing vouches for."""
    return (
        f"The analysis {analysis.name} is {_not_sealed(analysis)}: nothing beside it says that it is what was "
        "stored."
    )


def json_ready(content: Any) -> Any:
    """The same object with everything that JSON cannot hold made plain: numpy numbers, tuples; NaN
    and infinity are null.
    """
    if isinstance(content, Mapping):
        return {str(key): json_ready(value) for key, value in content.items()}
    if isinstance(content, (list, tuple, set, frozenset)):
        return [json_ready(value) for value in content]
    if isinstance(content, (str, bool)) or content is None:
        return content
    if isinstance(content, int):
        return int(content)
    if isinstance(content, float):
        return finite(float(content))
    for convert in ("tolist", "as_json"):
        if hasattr(content, convert):
            return json_ready(getattr(content, convert)())
    return str(content)


def json_text(value: Any) -> str:
    """An object as JSON text that every reader accepts."""
    return json.dumps(json_ready(value), indent=2, ensure_ascii=False, allow_nan=False)


def analysis_folder(run: str | Path) -> Path:
    """Where the analyses of a run file lie: `<run>.analysis` beside it."""
    run = Path(run)
    return run.with_name(
        re.sub(r"\.(h5|hdf5|nxs)(\.part)?\Z", "", run.name, flags=re.IGNORECASE) + ".analysis"
    )


def append_analysis(run: str | Path, result: Result, basis: Basis) -> Analysis:
    """Write an analysis beside its run under the next free number and return it.

    An analysis that says the very same as the newest one of its kind is not written twice: that one is returned. Raises
    `RunFileError` where nothing can be written.
    """
    folder = analysis_folder(run)
    content = {
        "format": STORE_FORMAT,
        "created": basis.created,
        **this_program().as_json(),
        **extension_records((extension_of(result.kind),)),
        "run": result.run,
        "run_file": Path(run).name,
        "run_sha256": basis.run_sha256,
        "kind": result.kind,
        "settings": dict(basis.settings),
        "tare": dict(basis.tare),
        "no_tare": list(basis.no_tare),
        "other_tares": [dict(named) for named in basis.other_tares],
        "gear": dict(basis.gear),
        "gear_source": dict(basis.gear_source),
        "result": result.as_json(),
        "tables": [table_to_mapping(table) for table in result.tables],
        "analysis_version": basis.analysis_version,
        "quantities": {
            name: _quantity(result, name) for name in (*result.estimates, *result.metrics)
        },
        "covariance": result.covariance,
        "checks": checks_to_mapping(result.checks),
    }
    content = json_ready(content)
    stored = read_analyses(run)
    same = [a for a in stored if a.kind == result.kind][-1:]
    if same and _without_time(same[0].content) == _without_time(content):
        return same[0]
    try:
        folder.mkdir(exist_ok=True)
        content["figures"] = _write_figures(folder, result)
        return _write_next(folder, content, stored[-1].number + 1 if stored else 1)
    except OSError as error:
        raise RunFileError(
            "the analysis cannot be written beside its run",
            where=str(folder),
            value=error.strerror or str(error),
            remedy="Make the folder writable, or copy the run to one that is.",
        ) from None


def _quantity(result: Result, name: str) -> dict[str, str]:
    """What an estimate or a metric is, for a reader who has this file alone."""
    quantity, estimate = result.quantity(name), result.estimates.get(name)
    return {
        "title": quantity.titled(name),
        "unit": estimate.unit if estimate else quantity.unit,
        "definition": quantity.definition,
    }


def _figures_name(text: bytes) -> str:
    """The name of a file of figures: by what it holds."""
    return f"figures-{hashlib.sha256(text).hexdigest()[:16]}.json.gz"


def _write_figures(folder: Path, result: Result) -> str:
    """Write the figures of a result under a name made of their content; the same figures are written once."""
    plots = [plot_to_mapping(plot) for plot in result.plots]
    # A hundred thousand numbers that nobody reads as text: without lines of their own they take a tenth of the time.
    text = json.dumps(plots, default=json_ready, ensure_ascii=False, allow_nan=False).encode()
    path = folder / _figures_name(text)
    if not path.exists():
        scratch = folder / f".{path.name}.{os.getpid()}.tmp"
        scratch.write_bytes(gzip.compress(text, compresslevel=6, mtime=0))
        scratch.chmod(stat.S_IRUSR | stat.S_IRGRP | stat.S_IROTH)
        scratch.replace(path)
    return path.name


def _write_next(folder: Path, content: Mapping[str, Any], number: int) -> Analysis:
    """Write under the first number from `number` on that nobody has; a number is taken by creating its note."""
    while True:
        path = folder / f"{number:04d}.json"
        numbered = {**content, "number": number}
        try:
            digest = write_sealed(path, (json_text(numbered) + "\n").encode())
            return Analysis(number, path, numbered, Seal(digest, is_whole=True))
        except FileExistsError:
            number += 1


def read_analyses(run: str | Path) -> tuple[Analysis, ...]:
    """The stored analyses of a run, oldest first. Raises `ChangedRunError` for one that is not as it was
    sealed, `RunFileError` for a file that is none.
    """
    folder = analysis_folder(run)
    if not folder.is_dir():
        return ()
    paths = [path for path in folder.iterdir() if _NUMBER.fullmatch(path.name)]
    return tuple(sorted(map(read_analysis, paths), key=lambda a: a.number))


def read_analysis(path: Path) -> Analysis:
    """One stored analysis, by its file. Raises as `read_analyses` does."""
    data, seal = read_sealed(path, is_sealed_from_birth=False)
    try:
        content = json.loads(data)
    except ValueError as error:
        raise RunFileError(
            "a stored analysis cannot be read", where=str(path), value=str(error)
        ) from None
    found = content.get("format") if isinstance(content, dict) else None
    if found not in (STORE_FORMAT, FORMAT_2, format_1.FORMAT):
        raise RunFileError(
            "is no analysis of this program", where=str(path), limit=f"format {STORE_FORMAT}"
        )
    if found == STORE_FORMAT and not seal.is_whole and not is_unsealed_allowed():
        raise unsealed(path)
    if found == format_1.FORMAT:
        content = format_1.from_format_1(content)
    match = _NUMBER.fullmatch(path.name)
    return Analysis(int(match[1]) if match else 0, path, content, seal)


def _without_time(content: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: value for key, value in content.items() if key not in ("created", "number", "figures")
    }
