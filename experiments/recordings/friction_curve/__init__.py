"""Friction over speed from a table."""
