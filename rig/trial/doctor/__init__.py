"""The rig looked over before anybody trusts it: a checklist in which every line has its evidence.

Start with `examine.py`. What is looked at while the rig stands is in `bus.py`, `standing.py` and
`surroundings.py`, one short function per line; what needs motion is a protocol of its own in
`motion.py`, run by the same session as any other run.
"""
