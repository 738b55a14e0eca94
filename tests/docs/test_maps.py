"""The channel maps that the pages print can be read, and the reference names every key."""

import re
from pathlib import Path

import pytest

from rig.runfile.importing import map_keys
from rig.runfile.importing.channel_map import read_channel_map
from tests.docs.test_reference_pages import pages

__all__ = ["pages"]
PAGE = Path(__file__).parents[2] / "docs" / "howto" / "import-a-recording.md"
MAPS = [
    text
    for text in re.findall(
        r"^```toml\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    if not text.startswith("[project")
]


@pytest.mark.parametrize("number", range(len(MAPS)))
def test_every_printed_map_is_one(number: int, tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text(MAPS[number], encoding="utf-8")
    for run in read_channel_map(path):
        assert run.options({}).channels


def test_the_reference_names_every_key_unit_and_label(pages: dict[str, str]) -> None:
    page = pages["channel-map"]
    for table, keys in map_keys.TABLES.items():
        if table != "reverse":
            part = page.partition(f"\n## {table}")[2].partition("\n## ")[0]
            assert [key.name for key in keys if f"| `{key.name}` |" not in part] == []
    for label in map_keys.LABELS:
        assert f"| `{label}` |" in page
    for unit in ("uN m", "lbf in", "count", "iso", "filetime"):
        assert f"`{unit}`" in page
