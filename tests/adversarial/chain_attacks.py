"""The chain of evidence attacked, each time on a fresh copy of a small gear.

`python -m tests.adversarial.chain_attacks` prints for each attack what finds it: reading (`rig certificate` refuses to
work with it), `verify` (`rig verify FOLDER`), `--recompute`, `--manifest` against a manifest that lies elsewhere, or
nothing, and why. `--only WORD` takes those whose names contain it; `--keep DIR` keeps the gear.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import numpy as np

from rig.analysis import store
from rig.gears.card_history import values_sha256
from rig.program import Program, this_program
from rig.runfile.manifest import Entry, Manifest, read_manifest
from rig.runfile.seal import file_sha256, hash_path
from tests.adversarial import chain_gear as gear
from tests.adversarial.chain_gear import FIRST, FRICTION, TARE

MANIFEST = "manifest.txt"
"""Of the whole gear, beside its folder."""
WAYS = ("reading", "verify", "--recompute", "--manifest")
NOTHING = (
    "nothing: whoever can write all files and has the only copy of all hashes can write any past"
)


@dataclass(frozen=True)
class Attack:
    """What is done, and how. `beside`: the manifest that is asked lies in the folder, and is attacked with it."""

    name: str
    act: Callable[[Path], object]
    beside: bool = False


def flip_a_count(folder: Path) -> None:
    run = folder / f"{FRICTION}.h5"
    data = bytearray(run.read_bytes())
    data[len(data) // 2] ^= 1
    gear.put(run, bytes(data), note=False)


def scale_the_torque(folder: Path) -> None:
    def half(file: object) -> None:
        counts = file["/entry/data/torque"]  # type: ignore[index]
        counts[...] = (np.asarray(counts[...]) * 0.5).astype(counts.dtype)

    gear.edit_run(folder / f"{FRICTION}.h5", half, note=True)


def relabel_as_hardware(folder: Path) -> None:
    def label(file: object) -> None:
        process = file["/entry/process"]  # type: ignore[index]
        for name, word in (("origin", "hardware"), ("origin_mark", "")):
            old = process[name]
            del process[name]
            process.create_dataset(name, data=word, dtype=old.dtype)

    gear.edit_run(folder / f"{FRICTION}.h5", label, note=True)


def edit_analysis(*, note: bool) -> Callable[[Path], None]:
    return lambda folder: gear.edit_json(gear.analysis(folder), gear.smaller, note=note)


def swap_analyses(folder: Path) -> None:
    gear.copy_over(gear.analysis(folder, FIRST), gear.analysis(folder))


def delete_run(folder: Path) -> None:
    gear.take(folder / f"{FRICTION}.h5")
    shutil.rmtree(folder / f"{FRICTION}.analysis")


def put_old_analysis_back(folder: Path) -> None:
    """The newer analysis, on which the certificate rests, is taken away: the older one is in force again."""
    gear.take(gear.analysis(folder, FRICTION, 2))


def relabel_analysis(folder: Path) -> None:
    """The older analysis is copied under the number of the newer one, its note too."""
    gear.copy_over(gear.analysis(folder), gear.analysis(folder, FRICTION, 2))


def swap_tare(folder: Path) -> None:
    """Another sealed run under the name of the tare."""
    gear.copy_over(folder / f"{FIRST}.h5", folder / f"{TARE}.h5")


def edit_tare_analysis(folder: Path) -> None:
    def less(content: dict) -> None:
        for number in content["result"]["parameters"].values():
            number["value"] = number["value"] and number["value"] * 1.5

    gear.edit_json(gear.analysis(folder, TARE), less, note=True)


def other_figures(folder: Path) -> None:
    old, new = (next((folder / f"{run}.analysis").glob("figures-*")) for run in (FRICTION, FIRST))
    gear.put(old, new.read_bytes(), note=False)


def edit_acceptance(folder: Path) -> None:
    gear.limits(folder, 0.5)


def other_acceptance(folder: Path) -> None:
    """A wider limit, and the certificate made anew with it, by the program itself."""
    gear.limits(folder, 0.5)
    gear.certify(folder)


def edit_card(folder: Path) -> None:
    path = gear.card_of(folder)
    text = path.read_text(encoding="utf-8").replace("circular-spline-fixed", "flexspline-fixed", 1)
    path.write_text(text, encoding="utf-8")


def edit_card_with_its_confirmation(folder: Path) -> None:
    from rig.gears.card import load_card

    path = gear.card_of(folder)
    before = load_card(path).history[-1]
    text = path.read_text(encoding="utf-8").replace("circular-spline-fixed", "flexspline-fixed")
    path.write_text(text, encoding="utf-8")
    after = load_card(path).history[-1]
    path.write_text(text.replace(before.sha256, values_sha256(after.values)), encoding="utf-8")


def edit_journal(folder: Path) -> None:
    path = gear.journal_of(folder)
    path.write_text(path.read_text(encoding="utf-8").replace("COMPLETED", "ABORTED", 1))


def cut_journal(folder: Path) -> None:
    path = gear.journal_of(folder)
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:-2]))


def rewrite_journal(folder: Path) -> None:
    gear.rewrite_journal(folder, lambda rows: rows[-1].update({"verdict": "PASS"}))


def edit_page(*, note: bool) -> Callable[[Path], None]:
    return lambda folder: gear.edit(folder / "c.html", "FAIL", "PASS", note=note)


def other_pdf(folder: Path) -> None:
    """The PDF of a made-up PASS, and a record that names its hash; the numbers of the record are left."""
    other = gear.copied(folder, folder.parent / "other")
    other_acceptance(other)
    gear.put(folder / "c.pdf", (other / "c.pdf").read_bytes(), note=True)
    record = json.loads((folder / "c.json").read_text(encoding="utf-8"))
    gear.update_record(
        folder, {"files": {**record["files"], "c.pdf": file_sha256(folder / "c.pdf")}}
    )
    shutil.rmtree(other)


def whole_certificate_of_a_pass(folder: Path) -> None:
    """All files of a certificate that was made where the limit is wider: pages, record, manifest, notes."""
    other = gear.copied(folder, folder.parent / "other")
    other_acceptance(other)
    for path in other.glob("c.*"):
        if not path.name.endswith(".sha256"):
            gear.put(folder / path.name, path.read_bytes(), note=True)
    shutil.rmtree(other)


def say_pass_in_the_record(folder: Path) -> None:
    def better(record: dict) -> None:
        record["verdict"] = "PASS"
        for line in record["limits"]:
            line["outcome"] = "PASS"

    gear.edit_json(folder / "c.json", better, note=True)


def shorten_the_manifest(folder: Path) -> None:
    path = folder / "c.manifest.txt"
    listed = read_manifest(path)
    kept = Manifest.made_of(listed.of, [e for e in listed.entries if e.kind != "acceptance"])
    gear.put(path, kept.as_bytes(), note=True)


def take_record(folder: Path) -> None:
    gear.take(folder / "c.json")


def analysis_and_certificate(folder: Path) -> None:
    """The analysis is edited and sealed anew, and the program writes the certificate of it."""
    gear.edit_json(gear.analysis(folder, FRICTION, 2), gear.smaller, note=True)
    gear.certify(folder)


def other_program(*, lying: bool) -> Callable[[Path], None]:
    """A program whose analysis answers 40 mN m less stores, seals and certifies; it says so, or names our hash."""

    def act(folder: Path) -> None:
        program = this_program() if lying else Program("0.3.0.dev0", "d" * 40, "e" * 64)
        path = gear.analysis(folder, FRICTION, 2)

        def made(content: dict) -> None:
            gear.smaller(content)
            content.update(program.as_json())

        gear.edit_json(path, made, note=True)
        with mock.patch.object(store, "this_program", return_value=program):
            gear.certify(folder)

    return act


def whole_chain(folder: Path) -> None:
    """Counts, notes, analyses, certificate: all made anew by the program itself from another recording."""
    scale_the_torque(folder)
    gear.rig("fit", folder / f"{FRICTION}.h5", "--tare", folder / f"{TARE}.h5")
    for number in (1, 2):
        gear.take(gear.analysis(folder, FRICTION, number))
    gear.rig("fit", folder / f"{FRICTION}.h5", "--tare", folder / f"{TARE}.h5")
    for path in (folder / f"{FRICTION}.analysis").glob("0003*"):
        path.unlink()
    gear.certify(folder)


def whole_chain_with_the_manifest(folder: Path) -> None:
    """The same, and the manifest that lies beside it is written anew."""
    whole_chain(folder)
    path = folder / "m.txt"
    path.unlink()
    gear.rig("verify", folder, "--manifest", path)


def list_no_run(folder: Path) -> None:
    """A run is deleted, and taken out of the manifest that lies beside it."""
    delete_run(folder)
    path = folder / "m.txt"
    listed = read_manifest(path)
    kept: list[Entry] = [e for e in listed.entries if not e.name.startswith(FRICTION)]
    path.write_bytes(Manifest.made_of(listed.of, kept).as_bytes())


ATTACKS = (
    Attack("run: one bit flipped", flip_a_count),
    Attack("run: torque halved, sealed anew", scale_the_torque),
    Attack("run: simulated relabelled as hardware, sealed anew", relabel_as_hardware),
    Attack("run: deleted with its analyses", delete_run),
    Attack("run: its note deleted", lambda f: hash_path(f / f"{FRICTION}.h5").unlink()),
    Attack("analysis: numbers edited", edit_analysis(note=False)),
    Attack("analysis: numbers edited, sealed anew", edit_analysis(note=True)),
    Attack("analysis: its note deleted", lambda f: hash_path(gear.analysis(f)).unlink()),
    Attack("analysis: that of another run in its place, sealed anew", swap_analyses),
    Attack("analysis: the newer one deleted, the old one back in force", put_old_analysis_back),
    Attack("analysis: the old one under the number of the newer", relabel_analysis),
    Attack("analysis: its figures swapped", other_figures),
    Attack("tare: another sealed run in its place", swap_tare),
    Attack("tare: its analysis edited, sealed anew", edit_tare_analysis),
    Attack("acceptance file: limit edited after the certificate", edit_acceptance),
    Attack("acceptance file: other limit, certificate made anew", other_acceptance),
    Attack("gear card: mounting edited", edit_card),
    Attack("gear card: mounting edited with its confirmation", edit_card_with_its_confirmation),
    Attack("journal: a line edited", edit_journal),
    Attack("journal: its last lines cut off", cut_journal),
    Attack("journal: rewritten from its first line on", rewrite_journal),
    Attack("certificate: HTML edited", edit_page(note=False)),
    Attack("certificate: HTML edited, sealed anew", edit_page(note=True)),
    Attack("certificate: another PDF, record and notes made to fit", other_pdf),
    Attack("certificate: all its files from a gear of a wider limit", whole_certificate_of_a_pass),
    Attack("certificate: PASS in its record, sealed anew", say_pass_in_the_record),
    Attack("certificate: its manifest shortened, sealed anew", shorten_the_manifest),
    Attack("certificate: its record deleted with its note", take_record),
    Attack("analysis edited and sealed, certificate made anew", analysis_and_certificate),
    Attack("other program, which says so: analysis and certificate", other_program(lying=False)),
    Attack("other program, which lies: analysis and certificate", other_program(lying=True)),
    Attack("whole chain made anew from another recording", whole_chain),
    Attack("whole chain made anew, manifest beside it too", whole_chain_with_the_manifest, True),
    Attack("run deleted, and taken out of the manifest beside it", list_no_run, True),
)


def found_by(folder: Path, manifest: Path, scratch: Path) -> tuple[dict[str, str], list[str]]:
    """Which ways find something in a folder that was attacked, each with its first words; and what is only told."""
    found = {}
    code, said = gear.certify(gear.copied(folder, scratch), "again.html", "html")
    shutil.rmtree(scratch)
    if code == 6:
        found["reading"] = said
    _, printed = gear.rig("verify", folder, "--recompute", "--manifest", manifest, "--json")
    told = json.loads(printed)
    findings = [finding for run in told["runs"] for finding in run["findings"]]
    wrong = [one["text"] for one in (*told["links"], *findings) if one["level"] == "error"]
    if wrong:
        found["verify"] = wrong[0]
    again = [one["text"] for one in told["recomputed"] if one["level"] == "error"]
    if again:
        found["--recompute"] = again[0]
    lost = told["manifest"]
    names = [f"{one['kind']} {one['name']}" for one in (*lost["missing"], *lost["changed"])]
    if names:
        found["--manifest"] = f"missing or changed: {', '.join(names)}"
    aloud = [
        one["text"]
        for one in (*told["links"], *findings)
        if one["level"] == "warning" and one.get("check") != "hash"
    ]
    return found, aloud


def prepared(folder: Path) -> Path:
    """The gear, with a second analysis of its newest run, on which the certificate rests."""
    gear.make_gear(folder)
    code, told = gear.rig("fit", folder / f"{FRICTION}.h5", "--tare", folder / f"{TARE}.h5")
    assert code in (0, 1, 3), told
    assert gear.analysis(folder, FRICTION, 2).exists(), told
    code, told = gear.certify(folder)
    assert code == 1, told
    code, told = gear.rig("verify", folder, "--manifest", folder.with_name(MANIFEST))
    assert code == 0, told
    return folder


def run_attack(attack: Attack, whole: Path, work: Path) -> tuple[dict[str, str], list[str]]:
    """An attack on a copy of the gear: the ways that find it, and what is said aloud of programs."""
    # At the place where the gear was made: its card names the acceptance file by its whole path.
    folder = gear.copied(whole, work / "runs")
    manifest = folder / "m.txt" if attack.beside else work / "elsewhere.txt"
    shutil.copyfile(work / MANIFEST, manifest)
    attack.act(folder)
    told = found_by(folder, manifest, work / "scratch")
    shutil.rmtree(folder)
    manifest.unlink(missing_ok=True)
    return told


def line_of(attack: Attack, found: Mapping[str, str], warnings: list[str]) -> str:
    """What is printed of an attack."""
    ways = ", ".join(way for way in WAYS if way in found) or NOTHING
    first = next((found[way] for way in WAYS if way in found), "")
    aloud = f"\n      said aloud: {warnings[0]}" if warnings else ""
    return f"{attack.name}\n      {ways}" + (f"\n      {first[:200]}" if first else "") + aloud


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", default="", help="part of a name")
    parser.add_argument("--keep", type=Path, help="folder in which the gear is made and kept")
    chosen = parser.parse_args()
    attacks = [attack for attack in ATTACKS if chosen.only in attack.name]
    with tempfile.TemporaryDirectory() as temporary:
        work = chosen.keep or Path(temporary)
        whole = work / "whole"
        if not whole.exists():
            prepared(work / "runs").rename(whole)
        unseen = 0
        for number, attack in enumerate(attacks, 1):
            found, warnings = run_attack(attack, whole, work)
            unseen += not found
            print(f"{number:2}  {line_of(attack, found, warnings)}", flush=True)
        print(f"{len(attacks)} attacks, {len(attacks) - unseen} found, {unseen} by nothing")


if __name__ == "__main__":
    main()
