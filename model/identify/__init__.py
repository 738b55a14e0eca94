"""Identification: arrays in, estimates out. No files, no runs, no plots.

Each module takes SI arrays and returns a frozen fit with `Estimate`s, metrics, warnings (sentences)
and the arrays of its plots: `kinematic_error` (streaming; on `angle_regression` and `angle_fit`, with `counting`
for slips and wrong ratios, `transmission` for the accuracy and `directions` for both directions and
figure 16), `friction` (on `running_torque` and `stribeck`), `dynamics` (velocity steps: a ladder of
`torsion` models on `step_problem`, `step_fit` and `step_data`, with `step_inertia` and
`sensitivity`), `motion` (inertia and friction from any motion), `revolution` (Fourier series per
revolution, order peaks). Bad data raise `IdentificationError`. Start reading in
`model.identify.estimate`.
"""
