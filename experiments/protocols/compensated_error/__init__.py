"""Compensated error: the same turn without and with a table that takes the kinematic error out; `plots` draws."""
