"""One export from beginning to end: the gear, its file, the notes beside it, the check in the target, the samples."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rig.errors import ConfigurationError
from rig.exchange import check, gear_json, mjcf, samples, urdf
from rig.exchange.identified import IdentifiedGear
from rig.exchange.joint import Form, FormName, Joint, Side, forms_of, seen_from
from rig.exchange.notes import Meaning, Notes, grid_text, notes_text

Target = Literal["json", "mjcf", "urdf"]
SUFFIXES: dict[Target, str] = {"json": ".json", "mjcf": ".xml", "urdf": ".urdf"}
"""What a target's file ends with."""


@dataclass(frozen=True, kw_only=True)
class Export:
    """What was made of a gear for a target: its text, the notes, what the target made of it, the draws."""

    target: Target
    identified: IdentifiedGear
    joint: Joint
    text: str
    notes: Notes
    checked: tuple[check.Row, ...] = ()
    samples: samples.Samples | None = None

    def as_json(self) -> dict[str, Any]:
        """As `rig export-model --json` prints it."""
        return {
            "target": self.target,
            "side": self.joint.side,
            "form": self.notes.form,
            "friction": {
                one.name: {"rms": one.rms, "worst": one.worst, "worst_at": one.worst_at}
                for one in self.notes.forms
            },
            "not_held": list(self.notes.cannot),
            "checked": [one.as_json() for one in self.checked],
            "samples": 0 if self.samples is None else len(self.samples.values),
            "remarks": list(self.notes.remarks),
        }


def exported(
    identified: IdentifiedGear,
    target: Target,
    *,
    side: Side = "joint",
    form: FormName = "lugre",
    draws: int = 0,
    seed: int = 0,
    is_checked: bool = False,
    file: str = "",
) -> Export:
    """An export. `form` is MJCF's: what an older MuJoCo reads is "linear". `file` is the name in the example.

    Raises `ConfigurationError` for draws of a gear that states no uncertainty, `RigError` where the target is to be
    simulated and not installed.
    """
    joint = seen_from(identified, side)
    forms = forms_of(joint)
    name = file or default_name(identified, target)
    text, notes = _made(identified, joint, target, forms, form, name)
    checked: tuple[check.Row, ...] = ()
    if is_checked and target == "json":
        checked = check.check_json(identified, text)
    elif is_checked:
        checked = check.check_in_mujoco(identified, joint, text)
    return Export(
        target=target,
        identified=identified,
        joint=joint,
        text=text,
        notes=notes,
        checked=checked,
        samples=samples.drawn(identified, draws, seed) if draws else None,
    )


def _made(
    identified: IdentifiedGear,
    joint: Joint,
    target: Target,
    forms: dict[FormName, Form],
    form: FormName,
    name: str,
) -> tuple[str, Notes]:
    every = tuple(forms.values())
    if target == "mjcf":
        text = mjcf.mjcf_text(identified, joint, forms[form])
        return text, mjcf.mjcf_notes(identified, joint, forms[form], every, name)
    if target == "urdf":
        text = urdf.urdf_text(identified, joint, forms["linear"])
        return text, urdf.urdf_notes(identified, joint, every, name)
    return gear_json.json_text(identified), _json_notes(identified, joint, name)


def _json_notes(identified: IdentifiedGear, joint: Joint, name: str) -> Notes:
    meanings = [
        Meaning(
            one.name,
            f"{one.value:.6g} {one.unit if one.unit != '1' else ''}".rstrip(),
            one.description,
        )
        for one in identified.parameters
        if not one.name.startswith("kinematic_error.")
    ]
    return Notes(
        title=f"{joint.name} as JSON, format {gear_json.FORMAT}",
        target=f"JSON, {gear_json.FORMAT}",
        joint=joint,
        meanings=tuple(meanings),
        form=None,
        forms=(),
        cannot=(
            "friction that depends on the load or on where the output stands",
            "a spring that hardens: its stiffness is one number",
        ),
        example=(
            "import json",
            f'gear = json.load(open("{name}", encoding="utf-8"))',
            'for one in gear["equations"]: print(one["number"], one["equation"])',
            'coulomb = gear["parameters"]["mesh_friction.coulomb"]',
            'print(coulomb["value"], coulomb["expanded_uncertainty"], coulomb["unit"])',
        ),
        remarks=identified.remarks,
    )


def default_name(identified: IdentifiedGear, target: Target) -> str:
    """A file's name by the gear: letters, digits and hyphens, then what the target's files end with."""
    name = identified.serial or identified.gear.name
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower() + SUFFIXES[target]


def _notes(export: Export) -> str:
    """The notes, and what the target made of the file where that was looked at."""
    text = notes_text(export.notes)
    if not export.checked:
        return text
    return text + "\n" + grid_text(check.check_grid(export.checked, export.notes.target)) + "\n"


def written(export: Export, output: Path) -> tuple[Path, ...]:
    """Write file, notes and draws beside each other; say where. Raises `ConfigurationError` where that cannot be."""
    files = {output: export.text, output.with_name(f"{output.name}.txt"): _notes(export)}
    if export.samples is not None:
        files[output.with_name(f"{output.name}.samples.csv")] = samples.table_text(export.samples)
    try:
        for path, text in files.items():
            path.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise ConfigurationError(
            f"cannot be written: {error.strerror or error}",
            where="--output",
            value=str(output),
            remedy="Choose a folder that is there and can be written.",
        ) from error
    return tuple(files)
