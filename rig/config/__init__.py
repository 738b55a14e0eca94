"""The file that describes a rig: `rig.toml`. The only place where pydantic reads text; unknown keys are refused.

Start with `schema.py` (what can be said) and `template.toml` (an example with every word
explained). `load_configuration` gives a checked `RigConfiguration`; what the devices are made of it
stands in `rig.backends.hardware`.
"""

from rig.config.load import Problem, inspect_configuration, load_configuration
from rig.config.schema import RigConfiguration

__all__ = ["Problem", "RigConfiguration", "inspect_configuration", "load_configuration"]
