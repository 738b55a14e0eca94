"""Kinematic error and transmission accuracy; `plots` draws."""
