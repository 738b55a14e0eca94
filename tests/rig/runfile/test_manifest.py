"""A manifest: the same files give the same bytes, and what was changed, taken away or added since is told."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from rig.errors import RigError
from rig.runfile.manifest import (
    HEADING,
    Entry,
    Manifest,
    changes_since,
    manifest_from,
    read_manifest,
)

RUN = Entry("2026/00001-friction-A1.h5", "run", "a" * 64)
CARD = Entry(".gears/A1.toml", "gear card", "b" * 64)
ODD = Entry("tab\there\nline \\n Grün\u2028.h5", "run", "c" * 64)


def test_the_same_files_in_any_order_give_the_same_sorted_text(tmp_path: Path) -> None:
    one = Manifest.made_of("gear A1", [RUN, CARD, ODD, RUN])
    assert one == Manifest.made_of("gear A1", [ODD, CARD, RUN])
    lines = one.as_bytes().decode().splitlines()
    assert lines[0] == HEADING + "gear A1"
    assert lines[1] == f".gears/A1.toml\tgear card\t{'b' * 64}"
    path = tmp_path / "m.txt"
    path.write_bytes(one.as_bytes())
    assert read_manifest(path) == one
    assert one.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_what_became_of_its_files() -> None:
    older = Manifest.made_of("x", [RUN, CARD])
    edited = Entry(CARD.name, CARD.kind, "d" * 64)
    changes = changes_since(older, Manifest.made_of("x", [edited, ODD]))
    assert changes.missing == (RUN,)
    assert changes.changed == ((CARD, edited),)
    assert changes.added == (ODD,)
    assert not changes.is_kept
    assert changes_since(older, Manifest.made_of("x", [RUN, CARD, ODD])).is_kept


@pytest.mark.parametrize(
    "text",
    [
        "",
        "nothing of ours\n",
        HEADING + "x\nname\trun\n",
        HEADING + f"x\nname\trun\t{'A' * 64}\n",
        HEADING + f"x\nb\trun\t{'a' * 64}\na\trun\t{'a' * 64}\n",
        HEADING + f"x\na\trun\t{'a' * 64}\na\trun\t{'a' * 64}\n",
        HEADING + f"x\na\trun\t{'a' * 64}",
    ],
)
def test_other_bytes_than_this_program_writes_are_refused(text: str) -> None:
    if text.endswith("a" * 64):
        text = text + "\r\n"
    with pytest.raises(RigError, match="no manifest of this program"):
        manifest_from(text.encode(), "m.txt")
