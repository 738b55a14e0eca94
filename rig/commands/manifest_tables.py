"""A manifest on the terminal: that it was written, or what became of its files, and the one hash over it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rig.commands.terminal import echo

if TYPE_CHECKING:
    from rig.trial.manifest import HeldManifest


def print_manifest(held: HeldManifest) -> None:
    """What was listed or compared, a line per file that is not as it was, and the hash to be kept elsewhere."""
    if held.changes is None:
        echo(f"{held.file}: {len(held.now.entries)} files listed, SHA-256 {held.now.sha256}")
        return
    echo(f"{held.file}: SHA-256 {held.older_sha256}; the folder now: {held.now.sha256}")
    for entry in held.changes.missing:
        echo(f"missing  {entry.kind} {entry.name}")
    for before, now in held.changes.changed:
        echo(f"changed  {now.kind} {now.name}: SHA-256 {now.sha256}, listed {before.sha256}")
    for entry in held.changes.added:
        echo(f"added    {entry.kind} {entry.name}")
    if held.changes.is_kept:
        echo("Nothing that is listed is missing or changed.")
