"""The harmonic drive itself: physics, parameter sets, simulation and identification.

This floor knows nothing of the rig: arrays and frozen parameter sets in, arrays and estimates out. It may import
numpy, scipy, numba and the standard library, and nothing of ours.

Start reading in `model.gear` (what a harmonic drive is here), then `model.dynamics` (equation 2) and `model.identify`.
"""
