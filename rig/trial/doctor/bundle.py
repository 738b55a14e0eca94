"""One file for whoever is to look into a device from afar: checklist, description, nodes, frames, versions; no persons.

checklist.json      what `rig doctor` found
rig.toml            the description, without [laboratory], with the EDS and DCF files that it names
nodes.json          what every node tells of itself, read by SDO
frames.log.gz       every frame of the examination while it stood (python-can's format)
commissioning.json  which stages were done, without who did them
versions.json       this program, Python, the system, the packages that speak on the bus
"""

from __future__ import annotations

import json
import platform
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from drivers.bus.discover import read_node
from drivers.errors import DriverError
from rig.bench.backends.assembly import AssembledRig
from rig.bench.commissioning import read_record
from rig.bench.config.load import load_configuration
from rig.bench.identity import Bench
from rig.errors import RigError
from rig.program import this_program
from rig.trial.doctor.examine import Examination

_PACKAGES = ("python-can", "canopen", "pyserial", "numpy", "scipy", "h5py")
_PERSONS = "[laboratory]"
"""The table of a description that names people and customers."""
_LONGEST_S = 3600.0


def write_bundle(
    path: Path,
    examination: Examination,
    rigs: Sequence[AssembledRig],
    bench: Bench | None,
    config: Path | None,
) -> tuple[str, ...]:
    """Write the file over an earlier one; the names of what is in it. Raises `RigError` where it cannot be written."""
    content: dict[str, bytes] = {
        "checklist.json": _json(examination.as_json()),
        "versions.json": _json(_versions()),
    }
    if config is not None:
        content |= dict(_description(config))
    if bench is not None:
        content["commissioning.json"] = _json(_stages(bench))
    for rig in rigs[:1]:
        content["nodes.json"] = _json(_nodes(rig))
        content |= dict(_frames(rig))
    try:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as bundle:
            for name, data in content.items():
                bundle.writestr(name, data)
    except OSError as error:
        raise RigError(
            "the bundle cannot be written", where=str(path), value=error.strerror or str(error)
        ) from error
    return tuple(content)


def _json(value: Any) -> bytes:
    return json.dumps(value, indent=2, ensure_ascii=False, default=str).encode() + b"\n"


def _versions() -> dict[str, Any]:
    packages = {name: metadata.version(name) for name in _PACKAGES}
    system = {"python": platform.python_version(), "system": platform.platform(terse=True)}
    return {**this_program().as_json(), **system, **packages}


def _description(config: Path) -> Iterator[tuple[str, bytes]]:
    """The description without people, and the device files that it names."""
    try:
        text = config.read_text(encoding="utf-8")
        yield config.name, without_persons(text).encode()
        configuration = load_configuration(config)
    except (OSError, RigError):
        return
    nodes = (configuration.drive, *configuration.counters, *configuration.analog_modules)
    for name in sorted({node.eds for node in nodes if node.eds}):
        file = config.parent / name
        if file.is_file():
            yield file.name, file.read_bytes()


def without_persons(text: str) -> str:
    """A description without the table that names people and customers."""
    kept, is_left_out = [], False
    for line in text.splitlines(keepends=True):
        if line.lstrip().startswith("["):
            is_left_out = line.split("#")[0].strip() == _PERSONS
        if not is_left_out:
            kept.append(line)
    return "".join(kept)


def _stages(bench: Bench) -> list[dict[str, Any]]:
    try:
        record = read_record(bench.state)
    except RigError as error:
        return [{"problem": str(error)}]
    return [{k: v for k, v in asdict(done).items() if k != "operator"} for done in record]


def _nodes(rig: AssembledRig) -> dict[str, Any]:
    """What every described node tells, or why it does not."""
    if rig.quiet_bus is None or rig.described is None:
        return {"problem": f"the rig '{rig.name}' has no bus"}
    told: dict[str, Any] = {}
    try:
        bus = rig.quiet_bus()
    except DriverError as error:
        return {"problem": str(error)}
    try:
        for node_id in dict.fromkeys(rig.described.node_ids):
            try:
                told[f"node {node_id}"] = asdict(read_node(bus, node_id))
            except DriverError as error:
                told[f"node {node_id}"] = {"problem": str(error)}
    finally:
        bus.close()
    return told


def _frames(rig: AssembledRig) -> Iterator[tuple[str, bytes]]:
    keep = rig.port.abilities.keep_frames
    if keep is None:
        return
    with tempfile.TemporaryDirectory(prefix="harmonic-rig-frames-") as folder:
        path = Path(folder) / "frames.log.gz"
        keep(path, _LONGEST_S)
        if path.exists():
            yield path.name, path.read_bytes()
