"""Velocity steps: `data` cuts the steps out of a recording, `plots` draws."""
