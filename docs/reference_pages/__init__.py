"""The reference pages that are made from the program: protocols, commands, orders, measurands, files, limits.

Nothing here is written twice: protocols come from their parameter models, commands from the command
line's own tables, words of files from their schemas.
"""

from __future__ import annotations

from pathlib import Path

from reference_pages import (
    assumed,
    channel_map,
    commissioning,
    files,
    fleet_results,
    measurands,
    order,
    program,
)

PAGES = {
    "protocols": program.protocols,
    "commands": program.commands,
    "order": order.order,
    "configuration": files.configuration,
    "commissioning": commissioning.commissioning,
    "exit-codes": program.exit_codes,
    "limits": program.limits,
    "gear-file": files.gear_file,
    "motor-file": files.motor_file,
    "acceptance-file": files.acceptance_file,
    "campaign-file": files.campaign_file,
    "channel-map": channel_map.channel_map,
    "measurands": measurands.measurands,
    "assumed": assumed.assumed,
    "fleet-results": fleet_results.fleet_results,
}
"""Every page that is made, by its name."""


def write(folder: Path) -> None:
    """Write every page, and leave alone what has not changed."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, lines in PAGES.items():
        text = "\n".join(lines()) + "\n"
        path = folder / f"{name}.md"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
