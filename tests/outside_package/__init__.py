"""A package of somebody else, as it would lie in an environment: nothing of the product knows it."""

from __future__ import annotations

import shutil
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from experiments import extensions

HERE = Path(__file__).parent
IMPORTS = "lab_noise"


def installed_into(site: Path, *, project: str = "", version: str = "") -> Path:
    """Lay the package into a folder as an installer would: its modules, and what its project file says of them."""
    text = project or (HERE / "pyproject.toml").read_text(encoding="utf-8")
    said = tomllib.loads(text)["project"]
    version = version or said["version"]
    shutil.copytree(
        HERE / IMPORTS,
        site / IMPORTS,
        dirs_exist_ok=True,
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    info = site / f"{said['name'].replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    metadata = {
        "Metadata-Version": "2.1",
        "Name": said["name"],
        "Version": version,
        "Summary": said["description"],
    }
    (info / "METADATA").write_text("".join(f"{k}: {v}\n" for k, v in metadata.items()))
    points = "".join(
        f"[{group}]\n" + "".join(f"{name} = {place}\n" for name, place in named.items())
        for group, named in said["entry-points"].items()
    )
    (info / "entry_points.txt").write_text(points)
    return site


@contextmanager
def found_in(site: Path) -> Iterator[None]:
    """The packages of a folder are there, and afterwards they are not."""
    sys.path.insert(0, str(site))
    forget()
    try:
        yield
    finally:
        sys.path.remove(str(site))
        forget()


def forget() -> None:
    """Nothing is known of other packages, and none of them is imported."""
    extensions.found.cache_clear()
    extensions._LEFT_OUT.clear()
    for name in [one for one in sys.modules if one.partition(".")[0] == IMPORTS]:
        del sys.modules[name]
