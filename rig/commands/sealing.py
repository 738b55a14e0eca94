"""The option `--unsealed`: files that were sealed when they were made, and whose note is gone, are used as they are."""

from __future__ import annotations

from typing import Annotated

import typer


def _allow(context: typer.Context, wanted: bool) -> bool:
    """Allow it until the command has ended."""
    if wanted:
        from rig.runfile.seal import allowing_unsealed

        context.with_resource(allowing_unsealed())
    return wanted


Unsealed = Annotated[
    bool,
    typer.Option(
        "--unsealed",
        callback=_allow,
        help="Use runs and analyses whose note of the SHA-256 is missing; every page then says so.",
    ),
]
