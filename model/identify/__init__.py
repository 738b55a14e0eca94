"""Identification: arrays in, estimates out. No files, no runs, no plots.

Each module takes SI arrays and returns a frozen fit with `Estimate`s: `kinematic_error`, `friction`, `dynamics` (velocity
steps), `motion` (inertia and friction from any motion), `revolution` (Fourier series per revolution, order spectrum).
Start reading in `model.identify.estimate`.
"""
