"""`rig live`: the window in which a technician prepares, runs and reviews."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from rig.bench.backends.order import Order
from rig.commands.ordering import Said, with_order

THEMES = ("system", "light", "dark")
PAGES = ("prepare", "run", "review", "fleet")
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
"""Environment variables of which one names where Qt may draw."""


@with_order("folder", "backend", "config")
def live(
    said: Said,
    theme: Annotated[str, typer.Option(help=f"Colours: {', '.join(THEMES)}.")] = "system",
    page: Annotated[
        str, typer.Option(help=f"The page to begin with: {', '.join(PAGES)}.")
    ] = "prepare",
) -> None:
    """Open the window: prepare a run, watch it, review what came of it.

    It needs the extra "window" (PySide6 and pyqtgraph). The run is a process of its own: closing
    the window during a run asks, and makes the rig safe.
    """
    for name, value, allowed in (("--theme", theme, THEMES), ("--page", page, PAGES)):
        if value not in allowed:
            raise typer.BadParameter(f"{value!r} is none of {', '.join(allowed)}", param_hint=name)
    from rig.errors import ConfigurationError

    try:
        from rig.window.main import open_window
    except ImportError as error:
        raise ConfigurationError(
            "the window cannot be opened: a library is missing",
            where=str(error.name or error),
            remedy="In the folder of the clone: .venv/bin/pip install -e '.[window]' (Windows: .venv\\Scripts\\pip). "
            "Every part also works on the command line.",
        ) from error
    if sys.platform == "linux" and not any(os.environ.get(name) for name in SCREENS):
        raise ConfigurationError(
            "there is no screen for a window",
            where=", ".join(SCREENS),
            value="none is set",
            remedy="Open it on a desktop. Every part also works on the command line.",
        )
    order = Order(protocol="", **said)
    if order.config is not None and not order.config.is_file():
        raise ConfigurationError("there is no such file", where="--config", value=str(order.config))
    _refuse_wrong_rig(order.backend)
    _refuse_wrong_folder(order.folder)
    raise typer.Exit(open_window(order.folder, order.backend, order.config, theme, page))


def _refuse_wrong_rig(backend: str) -> None:
    """Raise `ConfigurationError` for a rig that does not exist, before a window is opened for it."""
    from rig.bench.backends.registry import BACKENDS, REPLAY
    from rig.errors import ConfigurationError

    file = backend.removeprefix(REPLAY)
    if backend.startswith(REPLAY) and not Path(file).is_file():
        raise ConfigurationError(
            "there is no such run to replay",
            where="--backend",
            value=file,
            remedy=f"Name a run file: --backend {REPLAY}RUN.h5",
        )
    if backend not in BACKENDS and not backend.startswith(REPLAY):
        raise ConfigurationError(
            "no such rig",
            where="--backend",
            value=repr(backend),
            limit=", ".join((*BACKENDS, f"{REPLAY}RUN.h5")),
            remedy="Choose one of these.",
        )


def _refuse_wrong_folder(folder: Path) -> None:
    """Raise `ConfigurationError` for a folder of runs in which nothing can be written."""
    from rig.errors import ConfigurationError
    from rig.run.preflight import folder_problem

    problem = folder_problem(folder)
    if problem:
        raise ConfigurationError(
            f"runs cannot be kept there: {problem}",
            where="--runs",
            value=str(folder),
            remedy="Name a folder that you may write to.",
        )
