"""When a gear has changed: one function of its runs, with a promise of how often a healthy gear is told so.

`scores` makes standard normal numbers of a series, whatever warmth, bench and mounting did to it; `sums` adds them up
and says where they cross; `promise` is how often that may happen to a gear that does not change, `laboratory` reads it
from `rig.toml`, `threshold` keeps it; `noted` is what was noted of the runs; `watching` puts them together: whether a
series has changed, since when and by how much; `lines` fits steps and slopes; `wear` is what the hours of the gear do
to it.
"""
