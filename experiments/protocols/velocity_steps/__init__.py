"""Velocity steps: `protocol` plans and analyses, `data` cuts the steps out of a recording, `plots` draws."""
