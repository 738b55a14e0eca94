"""Friction over speed: `points` measures, `estimates` adds what no residual shows, `plots` draws."""
