"""The file that describes a rig: `rig.toml`. The only place where pydantic reads text; unknown keys are refused.

Start with `schema` (what can be said) and `template.toml` (an example with every word
explained). `load.load_configuration` gives a checked `RigConfiguration`; what the devices are made
of it stands in `rig.bench.backends.hardware`.
"""
