"""A campaign: the protocols that a gear goes through, in order, resumed where they stopped; one verdict at the end.

`plan` what is done, from a TOML file; `walk` all of it without a rig; `journal` what was done, on
disk; `standing` what of that still counts; `conduct` the doing. Nothing here judges: the verdict is that of
`rig.analysis.judging`.
"""
