"""A small simulated gear with everything that evidence on it consists of, and the hands of whoever attacks it."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Mapping
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import h5py

from rig.gears.acceptance import Acceptance, Limit
from rig.main import run as main
from rig.runfile.seal import hash_path
from rig.runfile.sealed import seal_in_place
from rig.trial.campaign import journal as journals
from rig.trial.campaign.journal import DoneStage
from rig.trial.campaign.plan import shipped_plan
from tests.rig.handmade import save_acceptance

GEAR = "A1"
WHO = ("--gear", GEAR, "--operator", "A. Example", "--world", "gear-seed=1")
SHORT = ("--lowest-rpm", "5", "--points", "9", "--measure-time", "0.3", "--settle-time", "0.2")
CARD = (
    "--part",
    "csf-25-120",
    "--mounting",
    "circular-spline-fixed",
    "--lubricant",
    "SK-1A",
    "--mounted-on",
    "2026-01-02",
)
TARE, FIRST, FRICTION = "00001-motor_tare-A1", "00002-friction-A1", "00003-friction-A1"
LIMIT = "friction.running_torque_1000_rpm"
AT = "2026-03-02T10:00:00+00:00"


def rig(*words: object) -> tuple[int, str]:
    """Exit code of a command, and what it printed."""
    output, errors = StringIO(), StringIO()
    code: Any = 0
    with redirect_stdout(output), redirect_stderr(errors):
        try:
            main([str(word) for word in words])
        except SystemExit as end:
            code = end.code or 0
    return int(code), output.getvalue() + " ".join(errors.getvalue().split())


def make_gear(folder: Path) -> Path:
    """A tare, two friction runs with their analyses, a confirmed card, a journal and a certificate that says FAIL."""
    folder.mkdir(parents=True)
    for protocol in ("motor-tare", "friction", "friction"):
        code, told = rig("run", protocol, *WHO, "--seed", 1, *SHORT, "--runs", folder)
        assert code in (0, 1, 3), told
    limits(folder, 0.05)
    facts = [*CARD, "--acceptance", folder / "spec.toml"]
    code, told = rig(
        "gear", "set", GEAR, *facts, "--by", "B. Example", "--confirm", "--runs", folder
    )
    assert code == 0, told
    journal = journals.begin(folder, shipped_plan("acceptance"), GEAR, {}, AT)
    for index, run in enumerate((TARE, FIRST, FRICTION)):
        stage = DoneStage(index=index, protocol=run[6:-3], run=f"{run}.h5", outcome="COMPLETED")
        journal = journal.with_stage(stage)
    certify(folder)
    journal.with_end("FAIL", "c.pdf", AT)
    return folder


def limits(folder: Path, upper: float) -> Path:
    """The acceptance file of the gear: one limit, on the running torque at 1000 r/min [N m]."""
    limit = Limit(
        quantity=LIMIT,
        unit="mN m",
        source="drawing 17",
        standing="customer",
        upper=upper,
        subject="gear",
        confirmed_by="C. Example",
        confirmed_on="2026-01-02",
    )
    path = folder / "spec.toml"
    made = Acceptance(name="spec", source="drawing 17", use="any", limits=(limit,), path=str(path))
    save_acceptance(made, path)
    return path


def certify(folder: Path, name: str = "c.pdf", form: str = "both") -> tuple[int, str]:
    """Write the certificate of the gear, as HTML and PDF."""
    spec = folder / "spec.toml"
    words = ("--gear", GEAR, "--runs", folder, "--acceptance", spec, "--format", form)
    return rig("certificate", *words, "--output", folder / name)


def analysis(folder: Path, run: str = FRICTION, number: int = 1) -> Path:
    """A stored analysis."""
    return folder / f"{run}.analysis" / f"{number:04d}.json"


def put(path: Path, data: bytes, *, note: bool) -> None:
    """Change a file although it is read-only; with `note` its SHA-256 beside it as well."""
    path.chmod(0o644)
    path.write_bytes(data)
    if note:
        seal_in_place(path, data)


def edit(path: Path, before: str, after: str, *, note: bool) -> None:
    """A text editor: every place of a text becomes another one."""
    text = path.read_text(encoding="utf-8")
    assert before in text, f"{path} does not say {before}"
    put(path, text.replace(before, after).encode(), note=note)


def edit_json(path: Path, change: Callable[[dict[str, Any]], None], *, note: bool) -> None:
    """Change a JSON file, laid out as the program lays it out."""
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    text = json.dumps(content, indent=2, ensure_ascii=False) + "\n"
    put(path, text.encode(), note=note)


def smaller(content: dict[str, Any]) -> None:
    """Make the judged number of an analysis smaller by 40 mN m."""
    number = content["result"]["parameters"][LIMIT.partition(".")[2]]
    for key in ("value", "low", "high"):
        number[key] -= 0.04


def edit_run(run: Path, change: Callable[[h5py.File], None], *, note: bool) -> None:
    """Change a run through the HDF5 library, as somebody who knows the format."""
    run.chmod(0o644)
    with h5py.File(run, "r+") as file:
        change(file)
    if note:
        seal_in_place(run, run.read_bytes())


def take(path: Path, *, note: bool = True) -> None:
    """Delete a file, and its note."""
    path.unlink()
    if note:
        hash_path(path).unlink()


def copy_over(source: Path, target: Path) -> None:
    """Put a file in the place of another, with a note of its own."""
    put(target, source.read_bytes(), note=True)


def rewrite_journal(folder: Path, change: Callable[[list[dict[str, Any]]], None]) -> None:
    """Write a campaign's journal anew from its first line on, each line with the hash of the one before."""
    (path,) = (folder / journals.FOLDER).glob("*.jsonl")
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    change(rows)
    before, lines = "", []
    for row in rows:
        line = json.dumps({**row, journals.BEFORE: before}, ensure_ascii=False).encode()
        before = hashlib.sha256(line).hexdigest()
        lines.append(line)
    path.write_bytes(b"\n".join(lines) + b"\n")


def journal_of(folder: Path) -> Path:
    """The journal of the gear's campaign."""
    (path,) = (folder / journals.FOLDER).glob("*.jsonl")
    return path


def card_of(folder: Path) -> Path:
    """The card of the gear."""
    return folder / ".gears" / f"{GEAR}.toml"


def update_record(folder: Path, changes: Mapping[str, Any]) -> None:
    """Change what the record of the certificate says, and its note."""
    edit_json(folder / "c.json", lambda record: record.update(changes), note=True)


def copied(folder: Path, target: Path) -> Path:
    """A copy of the whole gear."""
    return Path(shutil.copytree(folder, target))
