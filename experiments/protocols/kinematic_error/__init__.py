"""Kinematic error: `protocol` plans and analyses, `plots` draws."""
