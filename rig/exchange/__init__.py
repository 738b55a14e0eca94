"""An identified gear for other people's tools: JSON that code without ours reads, MuJoCo's MJCF, URDF.

Read first `identified` (what is known of a gear, with its joint covariance), then `joint` (its friction and inertia at
the motor or at the joint, and the forms that targets can hold), then one of the targets: `gear_json`, `mjcf`, `urdf`.
`samples` draws gears from what is known, `check` simulates in the target, `exporting` puts the files together.
Nothing that turns, records or judges a rig imports this room.
"""
