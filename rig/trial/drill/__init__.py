"""The drills: every fault that the rig must survive, let happen on a simulated rig in a short run, and what came of it.

Only simulated rigs are drilled: hardware is refused by name. Start reading at `suite.run_drills`;
`catalogue` is the list of faults, `rigs` puts a simulated rig with a fault together, `protocol` is
the run in which the fault happens.
"""
