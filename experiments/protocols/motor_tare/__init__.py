"""Friction and cogging of the bare motor."""
