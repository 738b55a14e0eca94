"""Friction over speed: `protocol` plans and analyses, `points` measures, `estimates` adds what no residual shows."""
