"""Recordings of other rigs, made into run files that are marked IMPORTED. Start in `convert`."""
