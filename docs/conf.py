"""How the documentation is built: `sphinx-build -W docs docs/_build`. The reference is made from the program itself."""

from __future__ import annotations

import sys
from importlib import metadata
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import reference_pages

project = "harmonic-rig"
author = "The harmonic-rig developers"
copyright = author
version = release = metadata.version("harmonic-rig")

extensions = ["myst_parser", "sphinx.ext.autodoc", "code_cells", "printed_output"]
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "description"
exclude_patterns = ["_build", "examples"]
html_theme = "furo"
html_title = "harmonic-rig"
html_theme_options = {"source_repository": "", "navigation_with_keys": True}

reference_pages.write(Path(__file__).parent / "reference" / "generated")
