"""The simulated rig: the plant behind the same seam that hardware has, in virtual time, seeded, and
worse than the model.

May import `model` and `drivers`. Start reading in `sim_backend.direct` (the simulated `RigPort`), then in
`sim_backend.imperfections` (everything that makes it worse than its model, each with a switch and a name) and
`sim_backend.drawing` (one rig in one world, drawn by its seeds).
"""
