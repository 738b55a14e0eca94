"""Angles of a recording: where they are counted from, and where the input turns one way."""
