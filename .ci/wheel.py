"""What a wheel must hold, asked of the environment in which it is installed; run by the gate with its Python."""

from __future__ import annotations

import sys
from importlib import import_module, metadata
from pathlib import Path

PACKAGES = ("harmonic_rig", "rig", "model", "drivers", "experiments", "sim_backend")

here = Path(sys.prefix).resolve()
for name in PACKAGES:
    module = import_module(name)
    assert module.__file__ is not None
    folder = Path(module.__file__).resolve().parent
    assert here in folder.parents, f"{name} comes from {folder}, not from the wheel"
    assert (folder / "py.typed").is_file(), (
        f"{name} is shipped without py.typed: its types are not seen"
    )
files = [str(file) for file in metadata.files("harmonic-rig") or () if file.suffix != ".pyc"]
strangers = {file.split("/")[0] for file in files} - {*PACKAGES, ".."}
strangers = {name for name in strangers if not name.endswith(".dist-info")}
assert not strangers, f"the wheel ships {strangers}"
# The same files give the same hash, in the clone beside this script and out of the wheel.
shipped = import_module("rig.program").this_program()
cloned = import_module("rig.program").files_sha256(Path(__file__).resolve().parents[1])
assert shipped.sha256 == cloned, f"the wheel's files are {shipped.sha256}, the clone's {cloned}"
print(
    f"harmonic-rig {metadata.version('harmonic-rig')}: {len(files)} files in {len(PACKAGES)} packages, typed, "
    f"SHA-256 {shipped.sha256}"
)
