"""A bench of hardware met for the first time: stages in an order, each looked at before the next may begin.

What the stages are, and the record of them, is `rig.bench.commissioning`. Here is what is done in them: `standing.py`
while nothing is switched on, `motion.py` by the motor, `stops.py` every way to stop it. Start with `conduct.py`.
"""
