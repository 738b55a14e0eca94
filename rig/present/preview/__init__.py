"""The preview of a plan: what it will do and what the model expects of this gear, before anything moves.

`preview.preview_plan` is where to start: a planned run in, speed over time, predicted torque and
output with their uncertainty, margins and warnings out, all as data. `timeline` walks the plan,
`torque` predicts the input torque, `output` what the output makes of it. Knows `rig.run` for the
planned run, and no window.
"""
