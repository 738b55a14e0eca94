"""Where the description of a rig is looked for, known without what reads it."""

from __future__ import annotations

from pathlib import Path

DEFAULT_PATH = Path("rig.toml")
"""In the present folder, unless another one is named."""
