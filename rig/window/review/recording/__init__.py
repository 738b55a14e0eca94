"""Somebody else's recording in the window: what its columns are, what stays open, and the run that is made of it."""
